// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/sea_state.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/spectral/light_field.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;

constexpr double kRefraction = 1.34;

// Zenith angle in air of a sun whose refracted light has that elevation under water.
double zenith_in_air_deg(double elevation_deg) {
  const double under = (90.0 - elevation_deg) * std::numbers::pi / 180.0;
  return std::asin(std::min(1.0, kRefraction * std::sin(under))) * 180.0 / std::numbers::pi;
}

Spectrum scaled(const Spectrum& spectrum, double factor) {
  return make_spectrum([&](int k) { return factor * spectrum[static_cast<std::size_t>(k)]; });
}

// The spectrum of an LED with a green raw value of 1.
Spectrum unit_led(const Sensor& sensor) {
  const Spectrum led = led_spectrum();
  return scaled(led, 1.0 / sensor.raw(led).y());
}

Spectrum reflectance(double r, double g, double b) {
  const auto basis = reflectance_basis();
  return make_spectrum([&](int k) {
    const auto i = static_cast<std::size_t>(k);
    return r * basis[0][i] + g * basis[1][i] + b * basis[2][i];
  });
}

// Attenuates a spectrum along a path.
Spectrum through(const Spectrum& light, const SpectrumF& coefficient, double path) {
  return make_spectrum([&](int k) {
    const auto i = static_cast<std::size_t>(k);
    return light[i] * std::exp(-static_cast<double>(coefficient[i]) * path);
  });
}

Spectrum sum(const Spectrum& a, const Spectrum& b) {
  return make_spectrum(
      [&](int k) { return a[static_cast<std::size_t>(k)] + b[static_cast<std::size_t>(k)]; });
}

Spectrum to_double(const SpectrumF& spectrum) {
  return make_spectrum(
      [&](int k) { return static_cast<double>(spectrum[static_cast<std::size_t>(k)]); });
}

}  // namespace

Daylight daylight_at(const SeaState& sea, double depth_m) {
  const double depth = std::max(0.0, depth_m);
  return {.total = through(to_double(sea.total), sea.diffuse, depth),
          .sun = through(to_double(sea.sun), sea.sun_decay, depth)};
}

Sea::Sea(const WaterConfig& water, const LightConfig& light, const SpectralConfig& spectral)
    : water_(water), light_(light), spectral_(spectral), sensor_(make_sensor(spectral.sensor)) {
  for (const SpectralLampConfig& lamp : spectral_.lamps) lobes_.emplace_back(lamp);
}

std::vector<LampPose> Sea::lamp_poses(const SE3& T_world_camera) const {
  std::vector<LampPose> poses;
  for (const SpectralLampConfig& lamp : spectral_.lamps) {
    const Vector3d position(lamp.position_m[0], lamp.position_m[1], lamp.position_m[2]);
    const Vector3d aim = Vector3d(lamp.aim[0], lamp.aim[1], lamp.aim[2]).normalized();
    poses.push_back(
        {(T_world_camera * position).cast<float>(), (T_world_camera.rotation * aim).cast<float>()});
  }
  return poses;
}

SeaState Sea::state(const Disturbance& disturbance, double time_s) const {
  const WaterOptics nominal = make_optics(water_.type, water_.attenuation_length_m);
  const auto& length = disturbance.attenuation_length_m;
  const WaterOptics local = length ? make_optics(water_.type, length) : nominal;
  const double brightness = std::clamp(1.0 - disturbance.darkness, 0.0, 1.0);
  SeaState sea;
  sea.light = light_;
  sea.sun_direction = sun_direction(light_).cast<float>();
  sea.sharp = to_float(local.sharp());
  sea.smooth = to_float(local.smooth());
  sea.scatter = to_float(local.scattering);
  // A cloud of turbid water is local: the daylight above it stays.
  sea.diffuse = to_float(nominal.diffuse(zenith_in_air_deg(light_.sun_elevation_deg)));
  const double slant = std::sin(light_.sun_elevation_deg * std::numbers::pi / 180.0);
  sea.sun_decay = to_float(scaled(nominal.smooth(), 1.0 / slant));
  const Spectrum daylight = scaled(daylight_spectrum(), light_.daylight * brightness);
  sea.total = to_float(daylight);
  sea.sun = to_float(scaled(daylight, light_.direct_fraction));
  const Spectrum led = unit_led(sensor_);
  for (const SpectralLampConfig& lamp : spectral_.lamps)
    sea.lamps.push_back(to_float(scaled(led, lamp.intensity * brightness)));
  sea.silt = {.density = disturbance.silt, .time_s = time_s, .color = Eigen::Vector3f::Zero()};
  Spectrum around = daylight_at(sea, water_.reference_depth_m).total;
  for (const SpectrumF& lamp : sea.lamps) around = sum(around, scaled(to_double(lamp), 0.1));
  const Spectrum mud = reflectance(0.38, 0.36, 0.29);
  sea.silt.color =
      sensor_
          .raw(make_spectrum([&](int k) {
            return mud[static_cast<std::size_t>(k)] * around[static_cast<std::size_t>(k)];
          }))
          .cast<float>();
  return sea;
}

Vector3d Sea::gray_card() const {
  constexpr double kDistance = 1.5;
  const SeaState sea = state({}, 0.0);
  Spectrum light = daylight_at(sea, water_.reference_depth_m).total;
  for (std::size_t i = 0; i < sea.lamps.size(); ++i) {
    const SpectralLampConfig& lamp = spectral_.lamps[i];
    const Vector3d from(lamp.position_m[0], lamp.position_m[1], lamp.position_m[2]);
    const double distance = (Vector3d(0.0, 0.0, kDistance) - from).norm();
    const Spectrum arriving = through(to_double(sea.lamps[i]), sea.smooth, distance);
    light = sum(light, scaled(arriving, 1.0 / (distance * distance)));
  }
  return sensor_.raw(through(light, sea.smooth, kDistance));
}

}  // namespace apvi::sim
