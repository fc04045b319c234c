// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/vio/config.hpp"
#include "vio/visual/resection.hpp"
#include "vio/visual/start_attempt.hpp"
#include "vio/window/observation.hpp"
#include "vio/window/window.hpp"

namespace apvi::vio {

/// Window and poses found from images alone. The world is the first body frame of the window; the
/// median distance of its landmarks is `VisualConfig::start_distance`.
struct VisualStart {
  Window window;
  std::vector<std::optional<SE3>> T_world_body;  ///< by given frame; empty: not found
};

/// Starts from images alone: the motion between the newest frame and the oldest one that has enough
/// tracks in common with it, resection of frames in between, and bundle adjustment. Every motion
/// that explains the two images is tried; that with the smallest reprojection error is taken, which
/// tells the two solutions of a flat scene apart.
/// Returns nullopt, with the reason in `waiting_for`, while the parallax is too small or no motion
/// fits.
std::optional<VisualStart> start_visually(const std::vector<TrackedFrame>& frames,
                                          const Config& config, const Rig& rig,
                                          std::string& waiting_for);

/// Positions of the triangulated landmarks.
PointsById landmark_positions(const Window& window);

}  // namespace apvi::vio
