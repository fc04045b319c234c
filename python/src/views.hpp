// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/sensors/camera_model.hpp"
#include "apvi/slam/map_snapshot.hpp"
#include "arrays.hpp"

namespace apvi::python {

/// Throws InputError for a camera with distortion or a pose [4,4] that is not rigid.
slam::RenderView to_view(const CameraModel& camera, const Numbers& T_world_camera);

}  // namespace apvi::python
