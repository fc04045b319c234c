// SPDX-License-Identifier: BSD-3-Clause
#include <sstream>

#include "apvi/core/error.hpp"
#include "fuzz/fuzz_target.hpp"
#include "io/folder/csv_sensors.hpp"
#include "io/folder/waterlinked_log.hpp"
#include "io/merged_reader.hpp"

// A dataset folder with arbitrary files, one for each sensor, separated by NUL bytes: CSV, and a
// log of a DVL.

namespace {

using namespace apvi;

io::CsvFile csv(std::string text) {
  return {std::make_unique<std::istringstream>(std::move(text)), "fuzz.csv"};
}

void add(io::Recording& recording, std::size_t sensor, std::string text) {
  switch (sensor) {
    case 0:
      return recording.add("imu", io::csv_imu(csv(std::move(text))));
    case 1:
      return recording.add("dvl", io::csv_dvl(csv(std::move(text))));
    case 2:
      return recording.add("pressure",
                           io::csv_pressure(csv(std::move(text)), io::PressureUnit::automatic));
    case 3:
      return recording.add("depth", io::csv_depth(csv(std::move(text))));
    case 4:
      return recording.add("gnss", io::csv_gnss(csv(std::move(text))));
    case 5:
      return recording.add("camera", io::csv_camera(csv(std::move(text)), "/nowhere", 0));
    case 6:
      return recording.add(
          "dvl", io::waterlinked_dvl(std::make_unique<std::istringstream>(std::move(text)), "log"));
    default:
      return;
  }
}

void read_all(io::Recording recording) {
  io::DatasetConfig config;
  config.start_s = 0.5;
  io::MergedReader reader(std::move(recording), config);
  Stamp last = Stamp::min();
  while (const auto event = reader.next()) {
    fuzz::check(stamp_of(*event) >= last, "events are out of order");
    fuzz::check(is_finite(*event), "an event is not finite");
    last = stamp_of(*event);
  }
  fuzz::check(reader.fraction() == 1.0, "progress at the end is not 1");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  io::Recording recording;
  std::size_t sensor = 0;
  for (const std::string& text : fuzz::split(data, size)) {
    try {
      add(recording, sensor++, text);
    } catch (const InputError&) {  // invalid header
    }
  }
  try {
    read_all(std::move(recording));
  } catch (const InputError&) {  // units that the rows do not tell
  }
  return 0;
}
