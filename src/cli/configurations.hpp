// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>

/// The configurations and scripts that come with the program.
namespace apvi::cli {

/// `name` itself if it exists, else the file of that name among the program's configurations:
/// share/apvi/configs of the installation, or configs/ of the source tree that it was built in.
/// Throws InputError, naming the places searched, when there is none.
std::filesystem::path find_configuration(const std::filesystem::path& name);

/// A script of the program, e.g. report.py; nothing when it is not installed.
std::optional<std::filesystem::path> find_script(const std::filesystem::path& name);

}  // namespace apvi::cli
