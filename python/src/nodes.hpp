// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "apvi/config/node.hpp"
#include "bindings.hpp"

/// Configuration nodes as Python's dict, list, str, float, int, bool and None.
namespace apvi::python {

/// Errors about the node name `source`. Throws InputError for other types.
config::Node to_node(const py::handle& value, const std::string& source);
/// Scalars become the type that their text has in YAML.
py::object to_object(const config::Node& node);

/// Whether the object names a file: str or os.PathLike.
bool is_path(const py::handle& value);
std::filesystem::path to_path(const py::handle& value);
/// Folder of the package's configurations, such as default.yaml.
std::filesystem::path configurations();

}  // namespace apvi::python
