// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "runs/run.hpp"

/// What the commands that make a run folder share.
namespace apvi::cli {

/// runs/<base>, with a numeric suffix when that folder exists.
std::filesystem::path vacant_folder(const std::string& base);
/// Logs the result of a run and prints its metrics.
void report(const runs::RunResult& result);

}  // namespace apvi::cli
