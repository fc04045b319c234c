// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "apvi/geometry/trajectory.hpp"
#include "mapping/keyframes/keyframe_store.hpp"

namespace apvi::slam {

/// The motion of the whole map, a rotation about z and a translation, that takes its training
/// keyframes to the final poses of their cameras, by least squares over the positions. Nothing when
/// fewer than two of them have a final pose.
std::optional<SE3> final_motion(const mapping::KeyframeStore& keyframes,
                                const Trajectory& final_camera_poses);

}  // namespace apvi::slam
