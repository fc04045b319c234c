// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>

#include "cli/mapping_support.hpp"
#include "runs/run.hpp"

/// What the commands that make a run folder share.
namespace apvi::cli {

/// runs/<base>, with a numeric suffix when that folder exists.
std::filesystem::path vacant_folder(const std::string& base);
/// --view and --view-address.
void add_view_options(CLI::App& command, ViewOptions& options);
/// Logs the result of a run and prints its metrics.
void report(const runs::RunResult& result);

}  // namespace apvi::cli
