// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "apvi/sensors/rig.hpp"
#include "localization/visual_pipeline.hpp"
#include "runs/calibrate/self_calibration.hpp"
#include "runs/run_config.hpp"
#include "vio/window/calibration.hpp"

namespace apvi::runs {

/// What a run has found: the parameters of the window, the camera by the bundle adjustment if there
/// was one, and the time offset of the DVL by DIPO. `rig` is that of the run.
vio::CalibrationEstimate found_calibration(const RunConfig& config, const Rig& rig,
                                           const localization::VisualPipeline& visual,
                                           const std::optional<DvlTimeOffset>& dvl_time_offset);

}  // namespace apvi::runs
