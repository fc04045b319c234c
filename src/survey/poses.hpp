// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "apvi/geometry/trajectory.hpp"

namespace apvi::survey {

/// Writes poses of a camera as CSV: stamp_ns,easting_m,northing_m,height_m,qw,qx,qy,qz. The
/// quaternion turns from the camera (x right, y down, z forward) to east, north and up. Throws
/// RunError.
void write_poses(const std::filesystem::path& file, const std::vector<StampedPose>& T_crs_camera);

}  // namespace apvi::survey
