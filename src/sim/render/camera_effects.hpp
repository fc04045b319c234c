// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "apvi/config/fields.hpp"

namespace apvi::sim {

enum class Shutter { global, rolling };

struct CameraEffectsConfig {
  double exposure_s = 0.008;
  int blur_samples = 3;
  Shutter shutter = Shutter::global;
  double readout_s = 0.015;
  bool auto_gain = true;
  double target_mean = 0.4;
  double gain = 2.0;
  double max_gain = 12.0;
  std::optional<std::array<double, 3>> white_balance{};
  double gamma = 1.0;
  double vignetting = 0.25;
  double lens_blur_px = 0.5;
  bool noise = true;
  double full_well_e = 12000.0;
  double read_noise_e = 6.0;

  template <typename V>
  void visit(V& v) {
    v("exposure_s", exposure_s, config::Range{0.0, 0.1}, "exposure time of a row [s]");
    v("blur_samples", blur_samples, config::Range{1, 15},
      "maximum poses per exposure for motion blur; fewer when the image moves less");
    v("shutter", shutter,
      config::Choices<Shutter>{{"global", Shutter::global}, {"rolling", Shutter::rolling}},
      "global: all rows are exposed at once; rolling: one after the other");
    v("readout_s", readout_s, config::Range{0.0, 0.1},
      "rolling: time from the first to the last row [s]");
    v("auto_gain", auto_gain, "automatic gain that brings the frame's mean to target_mean");
    v("target_mean", target_mean, config::Range{0.02, 0.9},
      "target mean of the linear image; full scale is 1");
    v("gain", gain, config::Range{0.001, 1000.0}, "gain without auto_gain");
    v("max_gain", max_gain, config::Range{0.01, 1000.0}, "maximum of the automatic gain");
    v("white_balance", white_balance, config::Range{0.0, 10.0},
      "factors of red, green, blue; null: partly toward gray in the scene's light");
    v("gamma", gamma, config::Range{0.5, 3.0},
      "pixel = light^(1/gamma); 1: linear, as in the paper");
    v("vignetting", vignetting, config::Range{0.0, 1.0}, "darkening in the corners");
    v("lens_blur_px", lens_blur_px, config::Range{0.0, 2.0}, "point spread, one sigma [px]");
    v("noise", noise, "shot and read noise");
    v("full_well_e", full_well_e, config::Range{100.0, 1e6},
      "full well capacity at gain 1 [electrons]");
    v("read_noise_e", read_noise_e, config::Range{0.0, 1000.0},
      "read noise, one sigma [electrons]");
  }
};

/// Blurs a CV_32FC3 image in place with a separable 3-tap Gaussian kernel of `sigma` [px].
void gaussian_blur(cv::Mat& image, double sigma);
/// Linear light (CV_32FC3, full scale 1) with shot and read noise, keyed by seed, frame and pixel.
cv::Mat with_sensor_noise(const cv::Mat& linear, const CameraEffectsConfig& config, double gain,
                          std::uint64_t seed, std::uint64_t frame);
/// Converts linear light (CV_32FC3 BGR, full scale 1) to the camera's 8-bit image: noise (keyed by
/// seed, frame and pixel), clipping, response curve. `gain` is the camera gain, for the noise
/// model.
cv::Mat simulate_sensor(const cv::Mat& linear, const CameraEffectsConfig& config, double gain,
                        std::uint64_t seed, std::uint64_t frame);
/// The same without noise.
cv::Mat simulate_noiseless_sensor(const cv::Mat& linear, const CameraEffectsConfig& config);

}  // namespace apvi::sim
