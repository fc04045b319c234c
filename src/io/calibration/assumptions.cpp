// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/assumptions.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <mutex>
#include <set>
#include <vector>

#include "apvi/sensors/rig.hpp"

namespace apvi::io {
namespace {

using config::Node;

// A key, the value that `make_rig` takes without it, and whether the result depends on it.
struct Default {
  const char* key;
  std::string value;
  bool matters;
};

std::vector<Default> defaults_of(const std::string& sensor) {
  const ImuCalibration imu;
  const CameraCalibration camera;
  const auto text = [](double value) { return fmt::format("{}", value); };
  if (sensor == "imu0") {
    return {{"rate_hz", text(imu.rate_hz), false},
            {"gyro_noise_density", text(imu.gyro_noise_density), true},
            {"gyro_random_walk", text(imu.gyro_random_walk), true},
            {"accel_noise_density", text(imu.accel_noise_density), true},
            {"accel_random_walk", text(imu.accel_random_walk), true}};
  }
  return {{"T_body_sensor", "identity", true},
          {"distortion", "none", true},
          {"rate_hz", text(camera.rate_hz), false},
          {"time_offset_s", text(camera.time_offset_s), false}};
}

bool is_first(const std::string& line) {
  static std::mutex mutex;
  static std::set<std::string> logged;
  const std::scoped_lock lock(mutex);
  return logged.insert(line).second;
}

}  // namespace

void log_once(log::Level level, const std::string& line) {
  if (is_first(line)) log::write(level, line);
}

void log_assumptions(const Node& rig, const std::string& name, std::vector<std::string> assumed) {
  bool matters = !assumed.empty();
  if (rig.find("world") == nullptr) assumed.emplace_back("world = up");
  for (const char* sensor : {"imu0", "cam0", "cam1"}) {
    const Node* section = rig.find(sensor);
    if (section == nullptr) continue;
    for (const Default& entry : defaults_of(sensor)) {
      const Node* value = section->find(entry.key);
      if (value != nullptr && !value->is_null()) continue;
      assumed.push_back(fmt::format("{}.{} = {}", sensor, entry.key, entry.value));
      matters = matters || entry.matters;
    }
  }
  if (assumed.empty()) return;
  log_once(
      matters ? log::Level::warning : log::Level::info,
      fmt::format("{}: assumed, as the file does not say: {}", name, fmt::join(assumed, ", ")));
}

}  // namespace apvi::io
