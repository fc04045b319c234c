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
    v("exposure_s", exposure_s, config::Range{0.0, 0.1}, "time a row collects light [s]");
    v("blur_samples", blur_samples, config::Range{1, 15},
      "most poses over an exposure; fewer are taken when the picture moves less");
    v("shutter", shutter,
      config::Choices<Shutter>{{"global", Shutter::global}, {"rolling", Shutter::rolling}},
      "whether all rows see the same instant");
    v("readout_s", readout_s, config::Range{0.0, 0.1}, "rolling: from first to last row [s]");
    v("auto_gain", auto_gain, "gain that brings the frame's mean to target_mean");
    v("target_mean", target_mean, config::Range{0.02, 0.9}, "of the linear image, full scale is 1");
    v("gain", gain, config::Range{0.001, 1000.0}, "when auto_gain is off");
    v("max_gain", max_gain, config::Range{0.01, 1000.0}, "limit of the automatic gain");
    v("white_balance", white_balance, config::Range{0.0, 10.0},
      "factors of red, green, blue; null: towards grey in the scene's light, most of the way");
    v("gamma", gamma, config::Range{0.5, 3.0}, "pixel = light^(1/gamma); 1: linear, as the paper");
    v("vignetting", vignetting, config::Range{0.0, 1.0}, "darkening in the corners");
    v("lens_blur_px", lens_blur_px, config::Range{0.0, 2.0}, "point spread, one sigma [px]");
    v("noise", noise, "shot and read noise");
    v("full_well_e", full_well_e, config::Range{100.0, 1e6}, "electrons of a full pixel at gain 1");
    v("read_noise_e", read_noise_e, config::Range{0.0, 1000.0}, "one sigma, electrons");
  }
};

/// Blurs a CV_32FC3 picture in place by three taps each way, a normal curve of `sigma` [px].
void soften(cv::Mat& picture, double sigma);
/// Linear light, CV_32FC3 BGR with full scale 1, as the 8-bit picture that the camera gives: noise
/// (keyed by seed, frame and pixel), clipping, response curve. `gain` is the camera's, for the
/// noise.
cv::Mat develop(const cv::Mat& linear, const CameraEffectsConfig& config, double gain,
                std::uint64_t seed, std::uint64_t frame);
/// The same without noise.
cv::Mat develop_clean(const cv::Mat& linear, const CameraEffectsConfig& config);

}  // namespace apvi::sim
