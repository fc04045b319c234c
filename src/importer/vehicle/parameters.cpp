// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/parameters.hpp"

#include <fmt/format.h>

#include <cmath>

#include "apvi/core/log.hpp"

namespace apvi::importer {

std::optional<double> VehicleParameters::find(const std::string& name) const {
  const auto found = values_.find(name);
  return found == values_.end() ? std::nullopt : std::optional(found->second);
}

void VehicleParameters::apply(int barometer, SensorData& data) const {
  const auto x = find("VISO_POS_X");
  const auto y = find("VISO_POS_Y");
  const auto z = find("VISO_POS_Z");
  if (x && y && z) data.p_body_dvl = Eigen::Vector3d(*x, *y, *z);
  constexpr double kFreshWater = 1000.0;
  const auto gravity = find("BARO_SPEC_GRAV");
  if (gravity && *gravity > 0.9 && *gravity < 1.3) data.water_density = kFreshWater * *gravity;
  const auto surface = find(fmt::format("BARO{}_GND_PRESS", barometer + 1));
  if (surface && *surface > 5e4 && *surface < 1.2e5) data.surface_pressure_pa = surface;
}

std::optional<DvlSample> dvl_of_delta(Stamp stamp, const Eigen::Vector3d& motion, double duration_s,
                                      double confidence) {
  if (!(duration_s > 0.0) || !std::isfinite(duration_s) || !motion.allFinite()) return {};
  DvlSample sample;
  sample.stamp = stamp;
  sample.velocity = motion / duration_s;
  sample.valid = confidence > 0.0;
  return sample;
}

void warn_of_internal_pressure(const std::string& name) {
  log::warning(
      "{}: has one barometer only, which is usually the one inside the housing; if its pressure "
      "does not change with depth, remove mav0/pressure0, and pressure0 from rig.yaml",
      name);
}

}  // namespace apvi::importer
