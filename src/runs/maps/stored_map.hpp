// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "gaussians/render/view.hpp"
#include "map_io/origin.hpp"
#include "mapping/rendering.hpp"
#include "runs/run_config.hpp"

namespace apvi::runs {

/// Camera intrinsics and extrinsics.
struct CameraMount {
  gaussians::Intrinsics intrinsics;
  SE3 T_body_camera;
};
/// The undistorted camera of a run's map. Throws InputError without one.
CameraMount mount_of_run(const RunConfig& config);

/// The view of a body pose.
gaussians::View view_at(const SE3& T_world_body, const CameraMount& mount);

struct StoredMap {
  mapping::Map map;  ///< on the device that renders
  map_io::Origin origin{};
};
/// The map file of a run folder, or the file itself.
std::filesystem::path map_file_of(const std::filesystem::path& source);
/// Reads the map of a run folder, or a map file. Throws InputError.
StoredMap load_drawable_map(const std::filesystem::path& source);
/// The path of the body in the frame of a run's map: the smoothed trajectory, or else the fused
/// one, or with given poses the keyframes. Empty without any. Throws InputError.
Trajectory load_path(const std::filesystem::path& run);

}  // namespace apvi::runs
