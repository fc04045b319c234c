// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/sensors/rig.hpp"
#include "apvi/vio/config.hpp"
#include "vio/result.hpp"
#include "vio/window/graph.hpp"
#include "vio/window/window.hpp"

namespace apvi::vio {

/// Solves the window with at most so many iterations, rejects outliers, and describes the newest
/// frame in `result`: its state, information, reprojection error, and whether it is a keyframe.
void solve_window(const Graph& graph, Window& window, const Config& config, const Rig& rig,
                  int iterations, Result& result);

}  // namespace apvi::vio
