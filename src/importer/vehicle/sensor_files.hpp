// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "importer/dive_writer.hpp"
#include "importer/vehicle/sensor_data.hpp"

namespace apvi::importer {

/// Whether a file is a log of an autopilot: MAVLink messages (.tlog) or DataFlash (.BIN).
bool is_vehicle_log(const std::filesystem::path& path);

/// Reads a file with the samples of sensors: a log of an autopilot, a csv file with the columns of
/// a data set folder, or a log of a Water Linked DVL. Throws InputError when it is none of these,
/// or has no sample.
SensorData read_sensor_file(const std::filesystem::path& path);

/// Reads files that share one clock; for a sensor that several have, the last one counts. Throws
/// InputError when their times do not overlap.
SensorData read_sensor_files(const std::vector<std::filesystem::path>& paths);

/// Writes the csv files of a data set folder, without loss.
void write_sensors(const SensorData& data, DiveWriter& dive);

}  // namespace apvi::importer
