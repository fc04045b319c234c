// SPDX-License-Identifier: BSD-3-Clause
// Speed of reading recordings, and memory growth with their size.
#include <benchmark/benchmark.h>
#include <fmt/format.h>
#include <malloc.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "apvi/core/error.hpp"
#include "apvi/io/sequence.hpp"
#include "io/rosbag/bag_writer.hpp"
#include "support/tmp_dir.hpp"
#include "synthetic_dive.hpp"

namespace apvi::bench {
namespace {

namespace fs = std::filesystem;

constexpr Duration kChunk{10'000'000'000};
constexpr Rates kRates{.imu = 200.0, .dvl = 8.0, .pressure = 10.0};

// One CSV file of a dataset folder.
class Csv {
 public:
  Csv(const fs::path& mav0, const std::string& sensor, const std::string& header) {
    fs::create_directories(mav0 / sensor);
    out_.open(mav0 / sensor / "data.csv", std::ios::binary);
    out_ << header << '\n';
  }
  void line(const std::string& text) { out_ << text << '\n'; }

 private:
  std::ofstream out_;
};

std::string imu_line(const ImuSample& s) {
  return fmt::format("{},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f}", s.stamp.ns, s.gyro.x(),
                     s.gyro.y(), s.gyro.z(), s.accel.x(), s.accel.y(), s.accel.z());
}

std::string dvl_line(const DvlSample& s) {
  std::string text =
      fmt::format("{},{:.7f},{:.7f},{:.7f},{:.5f},{:.4f},1", s.stamp.ns, s.velocity.x(),
                  s.velocity.y(), s.velocity.z(), *s.figure_of_merit, *s.altitude);
  for (const auto& beam : s.beams) text += fmt::format(",{:.7f}", beam->velocity);
  for (const auto& beam : s.beams) text += fmt::format(",{:.4f}", *beam->range);
  return text + ",1,1,1,1";
}

fs::path write_folder(const test::TmpDir& dir, double duration_s) {
  const fs::path mav0 = dir.path() / "mav0";
  Csv imu(mav0, "imu0",
          "#timestamp [ns],w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1],a_x [m s^-2],a_y [m s^-2],"
          "a_z [m s^-2]");
  Csv dvl(mav0, "dvl0",
          "#timestamp [ns],v_x [m s^-1],v_y [m s^-1],v_z [m s^-1],figure_of_merit [m s^-1],"
          "altitude [m],valid [0|1],beam0_v [m s^-1],beam1_v [m s^-1],beam2_v [m s^-1],"
          "beam3_v [m s^-1],beam0_range [m],beam1_range [m],beam2_range [m],beam3_range [m],"
          "beam0_valid,beam1_valid,beam2_valid,beam3_valid");
  Csv pressure(mav0, "pressure0", "#timestamp [ns],pressure [Pa]");
  dir.write(
      "rig.yaml",
      "body: imu0\nimu0: {rate_hz: 200}\ndvl0: {time_offset_s: 0.0}\npressure0: {noise_m: 0.01}\n");
  SyntheticDive dive(kRates, duration_s);
  for (auto events = dive.next(kChunk); !events.empty(); events = dive.next(kChunk)) {
    for (const SensorEvent& event : events) {
      if (const auto* s = std::get_if<ImuSample>(&event)) imu.line(imu_line(*s));
      if (const auto* s = std::get_if<DvlSample>(&event)) dvl.line(dvl_line(*s));
      if (const auto* s = std::get_if<PressureSample>(&event)) {
        pressure.line(fmt::format("{},{:.3f}", s->stamp.ns, s->pressure_pa));
      }
    }
  }
  return dir.path();
}

fs::path write_bag(const test::TmpDir& dir, double duration_s) {
  const fs::path path = dir.path() / "recording.bag";
  io::BagWriter bag(path);
  SyntheticDive dive(kRates, duration_s);
  for (auto events = dive.next(kChunk); !events.empty(); events = dive.next(kChunk)) {
    for (const SensorEvent& event : events) {
      if (const auto* s = std::get_if<ImuSample>(&event)) bag.write_imu("/imu/data", *s);
      if (const auto* s = std::get_if<DvlSample>(&event)) bag.write_dvl("/dvl/data", *s);
      if (const auto* s = std::get_if<PressureSample>(&event)) bag.write_pressure("/pressure", *s);
    }
  }
  bag.close();
  return path;
}

std::uintmax_t size_of(const fs::path& path) {
  if (fs::is_regular_file(path)) return fs::file_size(path);
  std::uintmax_t sum = 0;
  for (const auto& entry : fs::recursive_directory_iterator(path)) {
    if (entry.is_regular_file()) sum += entry.file_size();
  }
  return sum;
}

struct Reading {
  std::size_t samples = 0;
  double rss_peak_mib = 0.0;
  double rss_growth_mib = 0.0;  // since before the recording was opened
};

Reading read_all(const fs::path& path) {
  malloc_trim(0);  // release memory used for writing the recording
  const double rss_before = resident_mib();
  io::DatasetConfig config;
  config.path = path.string();
  const auto reader = io::open_sequence(config, {"imu", "dvl", "pressure"});
  Reading reading;
  while (const auto event = reader->next()) {
    benchmark::DoNotOptimize(stamp_of(*event));
    constexpr std::size_t kMemorySampleInterval = 16384;
    if (++reading.samples % kMemorySampleInterval == 0) {
      reading.rss_peak_mib = std::max(reading.rss_peak_mib, resident_mib());
    }
  }
  reading.rss_growth_mib = reading.rss_peak_mib - rss_before;
  return reading;
}

using Write = fs::path (*)(const test::TmpDir&, double);

void reading(benchmark::State& state, Write write) {
  const double duration_s = 60.0 * static_cast<double>(state.range(0));
  const test::TmpDir dir;
  try {
    const fs::path path = write(dir, duration_s);
    Reading result;
    for ([[maybe_unused]] auto _ : state) result = read_all(path);
    if (static_cast<double>(result.samples) < duration_s * kRates.imu) {
      state.SkipWithError("samples are missing");
    }
    const auto size = static_cast<std::int64_t>(size_of(path));
    state.SetBytesProcessed(state.iterations() * size);
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(result.samples));
    state.counters["file_mib"] = static_cast<double>(size) / (1024.0 * 1024.0);
    state.counters["rss_peak_mib"] = result.rss_peak_mib;
    state.counters["rss_growth_mib"] = result.rss_growth_mib;
  } catch (const RunError& error) {  // a build without rosbag_storage
    state.SkipWithError(error.what());
  }
}

BENCHMARK_CAPTURE(reading, folder, write_folder)
    ->ArgName("minutes")
    ->Arg(10)
    ->Arg(60)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(reading, bag, write_bag)
    ->ArgName("minutes")
    ->Arg(10)
    ->Arg(60)
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace apvi::bench
