// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/localization/options.hpp"

#include <algorithm>
#include <array>

#include "apvi/core/error.hpp"

namespace apvi::localization {

void Options::check() const {
  constexpr std::array<std::string_view, 4> kSensors = {"camera", "imu", "dvl", "pressure"};
  for (const std::string& name : sensors.use) {
    if (std::find(kSensors.begin(), kSensors.end(), name) == kSensors.end()) {
      fail_input("sensors.use: {} is not one of: {}", name, fmt::join(kSensors, ", "));
    }
  }
  if (!sensors.includes("camera") && !(sensors.includes("dvl") && sensors.includes("imu"))) {
    fail_input("sensors.use: needs camera, or dvl and imu, for odometry");
  }
  const double history_s = dipo.history_s;
  if (dipo.dvl.time_offset.estimate && dipo.dvl.time_offset.sigma > history_s) {
    fail_input("dipo.dvl.time_offset.sigma: {} s exceeds dipo.history_s ({} s)",
               dipo.dvl.time_offset.sigma, history_s);
  }
}

}  // namespace apvi::localization
