// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <istream>
#include <string>

#include "importer/vehicle/sensor_data.hpp"

namespace apvi::importer {

/// Reads a telemetry log of a ground station (.tlog): MAVLink messages, each after its time of
/// arrival as Unix microseconds. Stamps are those of the sender, on the clock of the ground
/// station. The IMU is that of RAW_IMU or another message that has one, the pressure that of the
/// barometer in the water (SCALED_PRESSURE2), the DVL's velocity that of VISION_POSITION_DELTA in
/// the body's axes forward, right, down. Damaged parts are skipped; a warning beginning with `name`
/// counts them.
SensorData read_mavlink_log(std::istream& in, const std::string& name);

}  // namespace apvi::importer
