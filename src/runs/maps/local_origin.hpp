// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "apvi/geometry/trajectory.hpp"
#include "map_io/origin.hpp"

namespace apvi::runs {

/// Local origin of a map with these poses: zero if their centroid is within 1 km of zero, else the
/// centroid, rounded to 100 m. Float32 resolves 0.06 mm at 1 km, but only 0.5 m at UTM northings.
map_io::Origin local_origin(const Trajectory& poses);

/// Poses relative to the origin, and back.
Trajectory to_local(Trajectory poses, const map_io::Origin& origin);
Trajectory to_recording(Trajectory poses, const map_io::Origin& origin);
/// T_camera_world [4,4] float64 of the recording's world, for the map's world.
torch::Tensor to_local(const torch::Tensor& T_camera_world, const map_io::Origin& origin);
/// Means [n,3] of Gaussians relative to the origin `to` instead of `from`.
torch::Tensor rebased(const torch::Tensor& means, const map_io::Origin& from,
                      const map_io::Origin& to);

}  // namespace apvi::runs
