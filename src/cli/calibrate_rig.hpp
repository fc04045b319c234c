// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>

namespace apvi::cli {

/// `apvi calibrate rig`.
void add_calibrate_rig(CLI::App& calibrate);

}  // namespace apvi::cli
