// SPDX-License-Identifier: BSD-3-Clause
#include <map>

#include "apvi/core/error.hpp"
#include "apvi/sensors/rig.hpp"
#include "fuzz/fuzz_target.hpp"
#include "io/folder/euroc_rig.hpp"

// EuRoC calibration files of the IMU and a camera, separated by a NUL byte.

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace apvi;
  const auto parts = fuzz::split(data, size);
  try {
    std::map<std::string, config::Node> sensors;
    sensors["imu0"] = io::parse_sensor_yaml(parts[0], "imu0/sensor.yaml");
    if (parts.size() > 1) sensors["cam0"] = io::parse_sensor_yaml(parts[1], "cam0/sensor.yaml");
    const Rig rig = make_rig(io::rig_of_sensor_yamls(sensors));
    for (const auto& camera : rig.cameras) {
      fuzz::check(camera.T_body_camera.translation.allFinite(), "a camera position is not finite");
      camera.model.unproject({10.0, 20.0});
    }
  } catch (const InputError&) {
  }
  return 0;
}
