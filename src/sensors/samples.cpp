// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/samples.hpp"

#include <cmath>

namespace apvi {
namespace {

bool finite(const ImuSample& s) {
  return s.gyro.allFinite() && s.accel.allFinite();
}
bool finite(const DvlSample& s) {
  if (!s.velocity.allFinite()) return false;
  for (const auto& beam : s.beams) {
    if (beam && (!std::isfinite(beam->velocity) || !std::isfinite(beam->range.value_or(0.0)))) {
      return false;
    }
  }
  return std::isfinite(s.figure_of_merit.value_or(0.0)) && std::isfinite(s.altitude.value_or(0.0));
}
bool finite(const PressureSample& s) {
  return std::isfinite(s.pressure_pa);
}
bool finite(const PressureDepthSample& s) {
  return std::isfinite(s.depth_m);
}
bool finite(const ImageFrame&) {
  return true;
}
bool finite(const GnssSample& s) {
  return s.east_north_up.allFinite();
}

constexpr std::array<std::string_view, 6> kKinds = {"imu",   "dvl",    "pressure",
                                                    "depth", "camera", "gnss"};
static_assert(kKinds.size() == std::variant_size_v<SensorEvent>);

}  // namespace

Stamp stamp_of(const SensorEvent& event) {
  return std::visit([](const auto& sample) { return sample.stamp; }, event);
}

std::string_view kind_of(const SensorEvent& event) {
  return kKinds[event.index()];
}

bool is_finite(const SensorEvent& event) {
  return std::visit([](const auto& sample) { return finite(sample); }, event);
}

}  // namespace apvi
