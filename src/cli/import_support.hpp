// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>
#include <vector>

#include "importer/import.hpp"

/// What `apvi import` and `apvi run SOURCE` share.
namespace apvi::cli {

/// Declares the options of an import; `options` must outlive `command`.
void add_import_options(CLI::App& command, importer::ImportOptions& options);

/// Imports and logs what was found. Throws RunError when interrupted.
void import_into(const std::filesystem::path& source, const std::filesystem::path& folder,
                 importer::ImportOptions options);

/// Overrides of the configuration that a folder made by an import needs; empty for other folders.
/// With given poses: a map without localization, and COLMAP's points as the initial ones.
std::vector<std::string> overrides_of_import(const std::filesystem::path& folder);

}  // namespace apvi::cli
