// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/io/sequence.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::test {

inline constexpr const char* kImuHeader =
    "#timestamp [ns],w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1],a_x [m s^-2],a_y [m s^-2],"
    "a_z [m s^-2]\n";
inline constexpr const char* kDvlHeader =
    "#timestamp [ns],v_x [m s^-1],v_y [m s^-1],v_z [m s^-1],figure_of_merit [m s^-1],altitude [m],"
    "valid [0|1],beam0_v [m s^-1],beam1_v [m s^-1],beam2_v [m s^-1],beam3_v [m s^-1],"
    "beam0_range [m],beam1_range [m],beam2_range [m],beam3_range [m],beam0_valid,beam1_valid,"
    "beam2_valid,beam3_valid\n";

/// One row of an IMU at rest.
inline std::string imu_row(std::int64_t ns) {
  return fmt::format("{},0.1,0.2,0.3,1,2,9.8\n", ns);
}

/// IMU rows at the given times [s].
inline std::string imu_rows(const std::vector<double>& seconds) {
  std::string rows;
  for (const double s : seconds) rows += imu_row(Duration::from_seconds(s).ns);
  return rows;
}

/// Writes a folder with an IMU only, with this CSV content.
inline void write_imu(const TmpDir& dir, const std::string& content) {
  dir.write("mav0/imu0/data.csv", content);
}

inline io::DatasetConfig config_for(const std::filesystem::path& path) {
  io::DatasetConfig config;
  config.path = path.string();
  return config;
}

/// All events of a recording, and the report on dropped samples.
struct DatasetContents {
  std::vector<SensorEvent> events;
  std::map<std::string, io::StreamReport> report;

  std::size_t dropped(const std::string& sensor, io::DropReason reason) const {
    const auto stream = report.find(sensor);
    if (stream == report.end()) return 0;
    const auto it = stream->second.dropped.find(reason);
    return it == stream->second.dropped.end() ? 0 : it->second;
  }
  std::size_t dropped(const std::string& sensor) const {
    std::size_t sum = 0;
    for (const auto& [reason, count] : report.at(sensor).dropped) sum += count;
    return sum;
  }
  std::size_t delivered(const std::string& sensor) const { return report.at(sensor).delivered; }
};

inline DatasetContents read_dataset(const io::DatasetConfig& config,
                                    const std::vector<std::string>& sensors = {}) {
  const auto reader = io::open_sequence(config, sensors);
  DatasetContents out;
  while (auto event = reader->next()) out.events.push_back(std::move(*event));
  out.report = reader->report();
  return out;
}

/// The message of the InputError that `f` throws; empty when it throws none.
template <typename F>
std::string input_error(F&& f) {
  try {
    f();
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

}  // namespace apvi::test
