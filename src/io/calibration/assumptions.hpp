// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "apvi/config/node.hpp"
#include "apvi/core/log.hpp"

namespace apvi::io {

/// Logs a line once per process, because programs read a rig more than once.
void log_once(log::Level level, const std::string& line);

/// Logs in one line the entries that the rig of another tool's file does not have, with the values
/// that are assumed: a warning when poses, lenses or noise are among them. `assumed` has further
/// ones, which are warnings.
void log_assumptions(const config::Node& rig, const std::string& name,
                     std::vector<std::string> assumed);

}  // namespace apvi::io
