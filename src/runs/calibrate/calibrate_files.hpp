// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "runs/calibrate/calibrate.hpp"

namespace apvi::runs::internal {

/// Unscaled eigenvalues of every frame used.
std::string eigenvalues_csv(const CalibrationResult& result);
/// Fits, thresholds and rejection rates.
std::string calibration_json(const CalibrationResult& result);

}  // namespace apvi::runs::internal
