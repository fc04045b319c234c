// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "apvi/geometry/se3.hpp"
#include "sim/motion/disturbance.hpp"
#include "sim/render/light.hpp"
#include "sim/render/silt.hpp"
#include "sim/spectral/spectral_config.hpp"
#include "sim/spectral/water_optics.hpp"

namespace apvi::sim {

/// A lamp in the world.
struct LampPose {
  Eigen::Vector3f position = Eigen::Vector3f::Zero();
  Eigen::Vector3f axis = Eigen::Vector3f::UnitZ();  ///< unit
};

/// Water and light of one frame. Irradiances are relative to daylight at the surface.
struct SeaState {
  SpectrumF sharp{};               ///< attenuation of the light that stays in its pixel [1/m]
  SpectrumF smooth{};              ///< attenuation without the small-angle scattering [1/m]
  SpectrumF scatter{};             ///< b [1/m]
  SpectrumF diffuse{};             ///< K_d [1/m]
  SpectrumF sun_decay{};           ///< of the direct sunlight, per meter of depth
  SpectrumF total{};               ///< daylight on a horizontal plane just below the surface
  SpectrumF sun{};                 ///< its direct part
  std::vector<SpectrumF> lamps{};  ///< irradiance at 1 m on the axis
  LightConfig light{};             ///< sun and caustics
  Eigen::Vector3f sun_direction = Eigen::Vector3f::UnitZ();  ///< toward the sun
  SiltCloud silt{};
};

/// The sea of a scene: everything that does not change between frames.
class Sea {
 public:
  Sea(const WaterConfig& water, const LightConfig& light, const SpectralConfig& spectral);

  SeaState state(const Disturbance& disturbance, double time_s) const;
  std::vector<LampPose> lamp_poses(const SE3& T_world_camera) const;
  const std::vector<LampLobe>& lobes() const { return lobes_; }
  const Sensor& sensor() const { return sensor_; }
  /// Raw values of a gray card that faces the camera at `water.reference_depth_m`, 1.5 m away.
  Eigen::Vector3d gray_card() const;

 private:
  WaterConfig water_;
  LightConfig light_;
  SpectralConfig spectral_;
  Sensor sensor_;
  std::vector<LampLobe> lobes_;
};

/// Daylight on a horizontal plane at a depth: total and its direct part.
struct Daylight {
  Spectrum total{};
  Spectrum sun{};
};
Daylight daylight_at(const SeaState& sea, double depth_m);

}  // namespace apvi::sim
