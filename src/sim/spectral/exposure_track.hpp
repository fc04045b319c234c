// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "sim/camera_effects.hpp"
#include "sim/spectral/development.hpp"
#include "sim/spectral/spectral_config.hpp"

namespace apvi::sim {

/// Mean raw values of the image at one instant.
struct Metering {
  double time_s = 0.0;
  Eigen::Vector3d raw = Eigen::Vector3d::Ones();  ///< red, green, blue
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

 private:
  std::vector<double> times_;
  std::vector<Development> states_;
};

}  // namespace apvi::sim
