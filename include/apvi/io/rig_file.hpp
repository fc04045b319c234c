// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "apvi/config/node.hpp"

namespace apvi::io {

/// Reads a calibration as the nodes of a rig.yaml, for `make_rig`: a rig.yaml, or a file of another
/// tool, which is recognized by its content:
///
/// - Kalibr: camchain.yaml, camchain-imucam.yaml (with the imu.yaml beside it), imu.yaml
/// - OpenVINS: estimator_config.yaml with the files that it names, or one of these
/// - EuRoC: sensor.yaml, or the folder `mav0`
/// - ROS: CameraInfo as camera_calibration writes it (ost.yaml)
/// - ORB-SLAM3: settings
///
/// Any of them may be listed under `inherit:` of a rig.yaml, whose own keys win. What the files of
/// other tools do not say is assumed, and logged once. `search`: see config::load_with_inheritance.
/// Throws InputError with file, line and key for values that are not understood, and for lenses
/// that are not supported.
config::Node load_rig_file(const std::filesystem::path& path,
                           const std::vector<std::filesystem::path>& search = {});

}  // namespace apvi::io
