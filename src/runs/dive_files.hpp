// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "loop_closure/correction_log.hpp"
#include "runs/sensor_spans.hpp"

namespace apvi::runs {

inline constexpr const char* kSensorsFile = "sensors.csv";
inline constexpr const char* kLoopsFile = "loops.csv";

/// sensors.csv: which sensor served when. Throws RunError.
void write_sensor_spans(const std::filesystem::path& file, const std::vector<SensorSpan>& spans);
/// Empty without the file. Throws InputError with file and line for an invalid one.
std::vector<SensorSpan> read_sensor_spans(const std::filesystem::path& file);

/// loops.csv: the stamps of the keyframes that each loop closure joins. Throws RunError.
void write_loops(const std::filesystem::path& file,
                 const std::vector<loop_closure::ClosedLoop>& loops);
/// Empty without the file. Throws InputError with file and line for an invalid one.
std::vector<loop_closure::ClosedLoop> read_loops(const std::filesystem::path& file);

}  // namespace apvi::runs
