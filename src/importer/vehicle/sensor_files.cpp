// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/sensor_files.hpp"

#include <fmt/format.h>

#include <array>
#include <fstream>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/text.hpp"
#include "importer/vehicle/dataflash.hpp"
#include "importer/vehicle/dataflash_log.hpp"
#include "importer/vehicle/mavlink_log.hpp"
#include "importer/vehicle/times.hpp"
#include "io/folder/csv_rows.hpp"
#include "io/folder/csv_sensors.hpp"
#include "io/folder/waterlinked_log.hpp"

namespace apvi::importer {
namespace {

namespace fs = std::filesystem;

std::string extension_of(const fs::path& path) {
  return text::to_lower(path.extension().string());
}

bool begins_like_dataflash(const fs::path& path) {
  std::array<std::uint8_t, 3> begin{};
  std::ifstream in(path, std::ios::binary);
  in.read(reinterpret_cast<char*>(begin.data()), begin.size());
  return in && is_dataflash(begin);
}

// Samples of a source that a data set could have as well.
class Collector {
 public:
  explicit Collector(SensorData& data) : data_(data) {}

  void drain(io::SampleSource& source) {
    SensorEvent event;
    while (true) {
      const io::SourceState state = source.next(event);
      if (state == io::SourceState::end) break;
      if (state == io::SourceState::sample && is_finite(event)) {
        std::visit([this](const auto& sample) { add(sample); }, event);
      } else if (dropped_++ == 0) {
        first_ = source.where();
      }
    }
    if (dropped_ > 0) log::warning("{}: malformed; {} such samples skipped", first_, dropped_);
  }

 private:
  void add(const ImuSample& sample) { data_.imu.push_back(sample); }
  void add(const DvlSample& sample) { data_.dvl.push_back(sample); }
  void add(const PressureSample& sample) { data_.pressure.push_back(sample); }
  void add(const PressureDepthSample& sample) { data_.depth.push_back(sample); }
  void add(const ImageFrame&) {}
  void add(const GnssSample&) {}

  SensorData& data_;
  std::size_t dropped_ = 0;
  std::string first_;
};

SensorData read_csv(const fs::path& path) {
  SensorData data;
  const io::CsvKinds kinds = io::csv_kinds(io::CsvFile(path));
  if (kinds.imu) Collector(data).drain(*io::csv_imu(io::CsvFile(path)));
  if (kinds.dvl) Collector(data).drain(*io::csv_dvl(io::CsvFile(path)));
  if (kinds.pressure) {
    Collector(data).drain(*io::csv_pressure(io::CsvFile(path), io::PressureUnit::automatic));
  } else if (kinds.depth) {
    Collector(data).drain(*io::csv_depth(io::CsvFile(path)));
  }
  data.put_in_order();
  return data;
}

SensorData read_dvl_log(const fs::path& path) {
  SensorData data;
  Collector(data).drain(*io::waterlinked_dvl(path));
  data.put_in_order();
  return data;
}

SensorData read_by_kind(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  const std::string extension = extension_of(path);
  if (begins_like_dataflash(path)) return read_dataflash_log(in, path.string());
  if (extension == ".tlog") return read_mavlink_log(in, path.string());
  if (extension == ".csv") return read_csv(path);
  if (extension == ".jsonl" || extension == ".json" || extension == ".log") {
    return read_dvl_log(path);
  }
  fail_input(
      "{}: not a file of sensors; expected .csv, .tlog, .BIN, or the log of a Water Linked DVL "
      "(.jsonl, .json, .log)",
      path.string());
}

void check_overlap(const SensorData& data, const SensorData& other, const fs::path& path) {
  const auto a = data.span();
  const auto b = other.span();
  if (!a || !b || (a->first <= b->second && b->first <= a->second)) return;
  const bool has_date = counts_from_1970(a->first);
  const bool other_has_date = counts_from_1970(b->first);
  fail_input(
      "{}: from {} to {}, but the other sensors are from {} to {}; all files must have the same "
      "clock{}",
      path.string(), time_text(b->first), time_text(b->second), time_text(a->first),
      time_text(a->second),
      has_date == other_has_date
          ? ""
          : ": a .BIN log without GNSS counts from when the autopilot was switched on; take the "
            ".tlog of the dive instead, or leave one of the files out");
}

template <typename Sample>
void write(const std::vector<Sample>& samples, const char* sensor, std::string_view header,
           DiveWriter& dive) {
  if (samples.empty()) return;
  std::string csv(header);
  csv += '\n';
  for (const Sample& sample : samples) csv += io::csv_row(sample, io::kExactDigits) + '\n';
  dive.write_text(fmt::format("mav0/{}/data.csv", sensor), csv);
}

}  // namespace

bool is_vehicle_log(const fs::path& path) {
  return extension_of(path) == ".tlog" || begins_like_dataflash(path);
}

SensorData read_sensor_file(const fs::path& path) {
  std::error_code unreadable;
  if (!fs::is_regular_file(path, unreadable)) fail_input("{}: no such file", path.string());
  SensorData data = read_by_kind(path);
  if (data.empty()) {
    fail_input("{}: no samples of an IMU, a DVL or a pressure sensor in it", path.string());
  }
  log::info("{}: samples: {}", path.string(), data.summary());
  return data;
}

SensorData read_sensor_files(const std::vector<fs::path>& paths) {
  SensorData data;
  for (const fs::path& path : paths) {
    SensorData more = read_sensor_file(path);
    check_overlap(data, more, path);
    data.take(std::move(more));
  }
  return data;
}

void write_sensors(const SensorData& data, DiveWriter& dive) {
  write(data.imu, "imu0", io::kImuCsvHeader, dive);
  write(data.dvl, "dvl0", io::kDvlCsvHeader, dive);
  write(data.pressure, "pressure0", io::kPressureCsvHeader, dive);
  write(data.depth, "depth0", io::kDepthCsvHeader, dive);
  if (data.gnss.empty()) return;
  std::string csv = "#timestamp [ns],latitude [deg],longitude [deg],altitude [m]\n";
  for (const GnssFix& fix : data.gnss) {
    csv += fmt::format("{},{:.10g},{:.10g},{:.6g}\n", fix.stamp.ns, fix.position.latitude_deg,
                       fix.position.longitude_deg, fix.position.altitude_m);
  }
  dive.write_text("mav0/gnss0/data.csv", csv);
}

}  // namespace apvi::importer
