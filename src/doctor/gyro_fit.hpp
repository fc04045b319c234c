// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "apvi/doctor/report.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::doctor {

/// Whether the gyro turns as the accelerometer's gravity does: carried along by the gyro, the
/// direction of gravity stays where it is over two seconds. Tried with the gyro as it is, reversed,
/// and taken as deg/s.
void check_gyro(const std::vector<ImuSample>& samples, Report& report);

}  // namespace apvi::doctor
