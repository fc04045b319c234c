// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>

#include "sim/render/camera_effects.hpp"
#include "sim/render/lens_rays.hpp"
#include "sim/spectral/development.hpp"
#include "sim/spectral/spectral_config.hpp"

namespace apvi::sim {

/// From the light in a camera to its pixels: shading by the lens, lens blur, noise, gain, white
/// balance, color matrix, tone curve. JPEG comes with the file.
class CameraPipeline {
 public:
  CameraPipeline(const CameraEffectsConfig& effects, const SpectralConfig& spectral,
                 const Sensor& sensor, const Lens& lens);

  /// The image (CV_8UC3 BGR) of raw values (CV_32FC3 BGR), which are changed.
  cv::Mat image(cv::Mat& raw, const Development& development, std::uint64_t seed,
                std::uint64_t frame) const;
  /// The same without lens shading and noise.
  cv::Mat clear_image(cv::Mat& raw, const Development& development) const;

  /// Mean of raw values (CV_32FC3 BGR, of any size) behind the lens, which the exposure control
  /// sees.
  cv::Scalar mean_behind_lens(const cv::Mat& raw) const;

  /// Matrix from raw red, green, blue to the linear light of the image.
  Eigen::Matrix3d linear(const Development& development) const;

 private:
  cv::Mat to_bytes(const cv::Mat& exposed, const Eigen::Matrix3d& colors) const;

  CameraEffectsConfig effects_;
  Eigen::Matrix3d colors_;
  ToneTable tone_;
  cv::Mat shading_;  ///< CV_32F: transmission of the lens
};

}  // namespace apvi::sim
