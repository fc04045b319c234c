// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "apvi/sensors/samples.hpp"
#include "doctor/report.hpp"

namespace apvi::doctor {

/// Checks gyro against accelerometer: rotated by the gyro, the direction of gravity must stay
/// constant over two seconds. Tests the gyro as it is, reversed, and interpreted as deg/s.
void check_gyro(const std::vector<ImuSample>& samples, Report& report);

}  // namespace apvi::doctor
