// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/sensors/rig.hpp"
#include "loop_closure/bundle_adjustment.hpp"
#include "vio/window/calibration.hpp"

namespace apvi::runs {

/// Puts the camera of the bundle adjustment, which has seen the whole dive, in the place of the
/// window's, as independent of the other parameters. `rig` is that of the run.
void adopt_camera(const loop_closure::BundleCamera& camera, const Rig& rig,
                  vio::CalibrationEstimate& estimate);

}  // namespace apvi::runs
