// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/config/node.hpp"

namespace apvi::io {

/// Whether a file is a ROS CameraInfo, as camera_calibration writes it (ost.yaml).
bool is_camera_info(const config::Node& file);
/// A rig with this camera: cam1 when the name of the file or `camera_name` has the word "right" or
/// "cam1", else cam0. The lens is that of the image as recorded; rectification is not used. Without
/// a lens model plumb_bob is assumed and logged. Throws InputError for values that are not
/// understood and lenses that are not supported.
config::Node rig_of_camera_info(const config::Node& file);

}  // namespace apvi::io
