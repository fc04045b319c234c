// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "sim/render/camera_effects.hpp"
#include "sim/spectral/development.hpp"
#include "sim/spectral/spectral_config.hpp"

namespace apvi::sim {

/// What the exposure control sees at one instant, and what it would see without water.
struct Metering {
  double time_s = 0.0;
  MeanLight light;
};

/// What the camera aims at for a mean: the gain that brings it to `target_mean`, at most
/// `max_gain`, and in automatic white balance factors toward gray (85 % of the way, 0.4 to 5).
Development aim(const Eigen::Vector3d& raw, const CameraEffectsConfig& effects, WhiteBalance mode,
                const Eigen::Vector3d& fixed);

/// Automatic exposure and white balance over a recording: both follow what they aim at with their
/// lags, as first-order filters of the logarithms, so that they do not depend on the order in
/// which frames are rendered.
class ExposureTrack {
 public:
  /// `fixed`: the white balance of the modes other than automatic. `meterings` in order of time.
  ExposureTrack(const std::vector<Metering>& meterings, const CameraEffectsConfig& effects,
                const SpectralConfig& spectral, const Eigen::Vector3d& fixed);

  Development at(double time_s) const;
  /// One exposure for all images without water, so that a surface has one brightness in them: the
  /// white balance of the middle of the recording, and the gain that brings their median to
  /// `target_mean`.
  const Development& clear() const { return clear_; }

 private:
  Development clear_;
  std::vector<double> times_;
  std::vector<Development> states_;
};

}  // namespace apvi::sim
