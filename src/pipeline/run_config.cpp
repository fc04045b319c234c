// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/run_config.hpp"

#include <algorithm>
#include <array>

#include "apvi/core/error.hpp"

namespace apvi::pipeline {

RunConfig load_run_config(const std::filesystem::path& file,
                          const std::vector<std::string>& overrides) {
  return read_run_config<RunConfig>(file, overrides);
}

RunConfig resolved(const RunConfig& config, const config::Node& rig) {
  RunConfig copy = config;
  copy.dataset.path = absolute_path(config.dataset.path);
  copy.localization.poses = absolute_path(config.localization.poses);
  copy.dataset.rig.clear();  // its content is in `rig`
  copy.rig = rig;
  return copy;
}

std::string absolute_path(const std::string& path) {
  return path.empty() ? path : std::filesystem::absolute(path).lexically_normal().string();
}

void check(const RunConfig& config) {
  if (!config.localization.enabled) return;  // no estimator, no demands
  constexpr std::array<std::string_view, 4> kSensors = {"camera", "imu", "dvl", "pressure"};
  for (const std::string& name : config.sensors.use) {
    if (std::find(kSensors.begin(), kSensors.end(), name) == kSensors.end()) {
      fail_input("sensors.use: {} is none of: {}", name, fmt::join(kSensors, ", "));
    }
  }
  const SensorsSection& sensors = config.sensors;
  if (!sensors.includes("imu")) fail_input("sensors.use: imu is missing; every estimator needs it");
  if (!sensors.includes("dvl") && !sensors.includes("camera")) {
    fail_input("sensors.use: dvl or camera is missing; without either there is no odometry");
  }
  const double most = config.dipo.history_s;
  if (config.dipo.dvl.time_offset.estimate && config.dipo.dvl.time_offset.sigma > most) {
    fail_input("dipo.dvl.time_offset.sigma: {} s is more than dipo.history_s keeps ({} s)",
               config.dipo.dvl.time_offset.sigma, most);
  }
}

config::Node rig_of(const RunConfig& config, const config::Node& recorded) {
  config::Node rig = recorded;
  if (!config.dataset.rig.empty()) rig = config::load_with_inheritance(config.dataset.rig);
  if (!config.rig.is_null()) config::merge(rig, config.rig);
  if (rig.is_null()) {
    fail_input("{}: no calibration: put a rig.yaml there, or name one in dataset.rig",
               config.dataset.path);
  }
  return rig;
}

}  // namespace apvi::pipeline
