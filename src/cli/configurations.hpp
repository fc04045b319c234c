// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

/// The configurations and scripts that come with the program.
namespace apvi::cli {

/// Folders of the program's configurations, where files are looked for that are neither at the path
/// given nor beside the file that inherits them: share/apvi/configs of the installation, or
/// configs/ of the source tree that it was built in.
std::vector<std::filesystem::path> configuration_folders();

/// `name` itself if it exists, else the file of that name in one of these folders, with or without
/// a leading configs/. Throws InputError, naming the places searched, when there is none.
std::filesystem::path find_configuration(const std::filesystem::path& name);

/// A script of the program, e.g. report.py; nothing when it is not installed.
std::optional<std::filesystem::path> find_script(const std::filesystem::path& name);

}  // namespace apvi::cli
