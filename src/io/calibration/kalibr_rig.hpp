// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/config/node.hpp"

namespace apvi::io {

/// Key of cam1 for the pose of cam1 in the frame of cam0, until the pose of cam0 is known.
inline constexpr const char* kStereoPose = "T_cam0_cam1";

/// Whether a file is Kalibr's camchain.yaml, camchain-imucam.yaml or imu.yaml, or OpenVINS's
/// kalibr_imucam_chain.yaml or kalibr_imu_chain.yaml.
bool is_kalibr(const config::Node& file);

/// Converts such a file to nodes of a rig.yaml; sections of rig.yaml in it are kept. Throws
/// InputError for values that are not understood and models that are not supported.
///
/// `T_cam_imu` maps IMU coordinates to the camera and `T_imu_cam` is its inverse. `T_cn_cnm1` maps
/// coordinates of the previous camera to this one. `timeshift_cam_imu` is added to a camera's stamp
/// to give the IMU's time: the negative of `time_offset_s`. Cameras after cam1 are ignored.
config::Node rig_of_kalibr(const config::Node& file);

}  // namespace apvi::io
