// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <istream>
#include <string>

#include "importer/vehicle/sensor_data.hpp"

namespace apvi::importer {

/// Reads a log that ArduPilot has written on board (.BIN). Stamps are Unix time if the log has a
/// GNSS fix, else the time since the autopilot was switched on. The IMU is the first one: GYR and
/// ACC, the raw samples, if they are logged, else IMU. The pressure is that of the barometer in the
/// water (BARO of instance 1), the DVL's velocity that of VISO in the body's axes forward, right,
/// down. Damaged parts are skipped; a warning beginning with `name` says so.
SensorData read_dataflash_log(std::istream& in, const std::string& name);

}  // namespace apvi::importer
