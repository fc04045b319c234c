// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

#include "apvi/config/node.hpp"

namespace apvi::config {

/// The first file called `name` in `folders`. A name may start with that of the folder:
/// configs/default.yaml and default.yaml are the same file of a folder `configs`.
std::optional<std::filesystem::path> find_in_folders(
    const std::vector<std::filesystem::path>& folders, const std::filesystem::path& name);

/// The file that a configuration file in `folder` names under `key`: relative to that folder, else
/// in one of the folders `search`. Throws InputError when there is none.
std::filesystem::path inherited_file(const Node& name, std::string_view key,
                                     const std::filesystem::path& folder,
                                     const std::vector<std::filesystem::path>& search);

}  // namespace apvi::config
