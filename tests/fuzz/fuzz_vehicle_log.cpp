// SPDX-License-Identifier: BSD-3-Clause
#include <sstream>

#include "fuzz/fuzz_target.hpp"
#include "importer/vehicle/dataflash_log.hpp"
#include "importer/vehicle/mavlink_log.hpp"

// Logs of an autopilot: DataFlash, and MAVLink messages with times of arrival.

namespace {

template <typename Samples>
void check_order(const Samples& samples) {
  for (std::size_t i = 1; i < samples.size(); ++i) {
    apvi::fuzz::check(samples[i - 1].stamp < samples[i].stamp, "samples are out of order");
  }
}

void check(const apvi::importer::SensorData& data) {
  check_order(data.imu);
  check_order(data.dvl);
  check_order(data.pressure);
  for (const auto& sample : data.dvl) {
    apvi::fuzz::check(sample.velocity.allFinite(), "a velocity that is not finite");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace apvi;
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  std::istringstream dataflash(bytes);
  check(importer::read_dataflash_log(dataflash, "dive.BIN"));
  std::istringstream telemetry(bytes);
  check(importer::read_mavlink_log(telemetry, "dive.tlog"));
  return 0;
}
