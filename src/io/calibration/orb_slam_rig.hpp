// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/config/node.hpp"

namespace apvi::io {

/// Whether a file holds settings of ORB-SLAM3 (`Camera1.fx`) or its older form (`Camera.fx`).
bool is_orb_slam(const config::Node& file);
/// Converts them to nodes of a rig.yaml. `IMU.T_b_c1` (`Tbc`) maps camera coordinates to the body,
/// and `Stereo.T_c1_c2` (`Tlr`) those of the second camera to the first. Noise values are
/// densities. Throws InputError for values that are not understood, lenses that are not supported,
/// and the older stereo settings, whose intrinsics are those of rectified images.
config::Node rig_of_orb_slam(const config::Node& file);

}  // namespace apvi::io
