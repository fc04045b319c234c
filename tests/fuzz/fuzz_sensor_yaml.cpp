// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"
#include "apvi/sensors/rig.hpp"
#include "fuzz/fuzz_target.hpp"
#include "io/calibration/foreign_rig.hpp"

// Calibration files of other tools, two of them separated by a NUL byte: of the IMU and a camera.

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace apvi;
  const auto parts = fuzz::split(data, size);
  try {
    config::Node node;
    for (std::size_t i = 0; i < parts.size() && i < 2; ++i) {
      config::Node file =
          config::parse_yaml(parts[i], i == 0 ? "imu0/sensor.yaml" : "cam0/sensor.yaml");
      if (io::convert_foreign(file)) config::merge(node, file);
    }
    io::finish_foreign(node, "fuzz");
    const Rig rig = make_rig(node);
    for (const auto& camera : rig.cameras) {
      fuzz::check(camera.T_body_camera.translation.allFinite(), "a camera position is not finite");
      camera.model.unproject({10.0, 20.0});
    }
  } catch (const InputError&) {
  }
  return 0;
}
