// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>

namespace apvi::cli {

/// Adds `mask` to the command `camera`.
void add_camera_mask(CLI::App& camera);

}  // namespace apvi::cli
