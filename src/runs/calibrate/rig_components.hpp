// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "apvi/sensors/rig.hpp"
#include "runs/calibrate/calibration_combination.hpp"
#include "runs/calibrate/rig_calibration.hpp"

namespace apvi::runs {

/// The components of a combined calibration with names and units. `parameters`: their names and
/// sizes.
std::vector<RigComponent> components(const Rig& rig,
                                     const std::vector<vio::CalibrationParameter>& parameters,
                                     const CombinationInput& input, const Combination& found);

}  // namespace apvi::runs
