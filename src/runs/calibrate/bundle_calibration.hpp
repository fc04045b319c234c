// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/sensors/rig.hpp"
#include "loop_closure/bundle_adjustment.hpp"
#include "vio/window/calibration.hpp"

namespace apvi::runs {

/// Puts the camera of the bundle adjustment, which has seen the whole dive, in the place of the
/// window's. What the window knows about the other parameters depends on the camera (a camera and a
/// DVL that are turned alike move alike), so these follow: their mean and covariance are those
/// under the condition that the camera is the adjusted one. `rig` is that of the run.
void adopt_camera(const loop_closure::BundleCamera& camera, const Rig& rig,
                  vio::CalibrationEstimate& estimate);

}  // namespace apvi::runs
