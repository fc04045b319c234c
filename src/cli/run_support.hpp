// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>
#include <vector>

#include "cli/mapping_support.hpp"
#include "runs/run.hpp"

/// What the commands that run recordings share.
namespace apvi::cli {

/// runs/<base>, with a numeric suffix when that folder exists.
std::filesystem::path vacant_folder(const std::string& base);
/// --set KEY=VALUE, once for each key: one value at a time, so that positional arguments may
/// follow.
void add_overrides(CLI::App& command, std::vector<std::string>& overrides,
                   const std::string& description);
/// --view and --view-address.
void add_view_options(CLI::App& command, ViewOptions& options);
/// Logs the result of a run and prints its metrics.
void report(const runs::RunResult& result);

}  // namespace apvi::cli
