// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "apvi/pipeline/calibrate.hpp"

namespace apvi::pipeline::internal {

/// Every frame that was used, eigenvalues as they are.
std::string eigenvalues_csv(const CalibrationResult& result);
/// Fits, thresholds and outcomes.
std::string calibration_json(const CalibrationResult& result);

}  // namespace apvi::pipeline::internal
