// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>

#include "loop_closure/keyframe_graph.hpp"
#include "loop_closure/place.hpp"

namespace apvi::loop_closure {

/// The relative pose of two keyframes by the features that match, with roll and pitch of the
/// odometry: least squares over heading and position (`fit_level_pose`). A tilt that images leave
/// uncertain is a shift along the ground. The covariance of the fit adds to `kLoopSigmas`, which
/// stands for errors that the points of a place share. `ray_sigma`: on the plane z = 1. Nullopt if
/// the features do not determine the pose.
std::optional<Loop> measure_loop(const KeyframeGraph& graph, std::size_t from, std::size_t to,
                                 const PlaceMatch& match, double ray_sigma);

}  // namespace apvi::loop_closure
