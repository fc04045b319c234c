// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/camera_pipeline.hpp"

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "sim/world/noise_texture.hpp"

namespace apvi::sim {
namespace {

// cos^4 of the angle from the axis, and the edge of the barrel from 60 % of the half diagonal on.
cv::Mat lens_shading(const Lens& lens, double barrel) {
  cv::Mat shading(lens.height, lens.width, CV_32F);
  const double diagonal = std::hypot(0.5 * lens.width, 0.5 * lens.height);
  for (int y = 0; y < lens.height; ++y) {
    for (int x = 0; x < lens.width; ++x) {
      const double radius =
          std::hypot(x + 0.5 - 0.5 * lens.width, y + 0.5 - 0.5 * lens.height) / diagonal;
      const auto edge = static_cast<double>(smooth_step(0.6F, 1.1F, static_cast<float>(radius)));
      const double cosine = std::fmax(0.0F, lens.rays[lens.index(x, y)].z());
      shading.at<float>(y, x) = static_cast<float>(std::pow(cosine, 4.0) * (1.0 - barrel * edge));
    }
  }
  return shading;
}

void shade_lens(const cv::Mat& shading, float gain, cv::Mat& raw) {
  for (int y = 0; y < raw.rows; ++y) {
    auto* row = raw.ptr<cv::Vec3f>(y);
    const auto* factor = shading.ptr<float>(y);
    for (int x = 0; x < raw.cols; ++x) row[x] *= gain * factor[x];
  }
}

}  // namespace

CameraPipeline::CameraPipeline(const CameraEffectsConfig& effects, const SpectralConfig& spectral,
                               const Sensor& sensor, const Lens& lens)
    : effects_(effects),
      colors_(Eigen::Matrix3d::Identity() +
              spectral.color_correction * (color_matrix(sensor) - Eigen::Matrix3d::Identity())),
      tone_(spectral.tone, effects.gamma),
      shading_(lens_shading(lens, spectral.lens_shading)) {}

Eigen::Matrix3d CameraPipeline::linear(const Development& development) const {
  return development.gain * colors_ * development.white_balance.asDiagonal();
}

cv::Mat CameraPipeline::to_bytes(const cv::Mat& exposed, const Eigen::Matrix3d& colors) const {
  const Eigen::Matrix3f m = colors.cast<float>();
  cv::Mat image(exposed.size(), CV_8UC3);
  for (int y = 0; y < exposed.rows; ++y) {
    const auto* in = exposed.ptr<cv::Vec3f>(y);
    auto* out = image.ptr<cv::Vec3b>(y);
    for (int x = 0; x < exposed.cols; ++x) {
      const float r = in[x][2];
      const float g = in[x][1];
      const float b = in[x][0];
      for (int c = 0; c < 3; ++c) out[x][2 - c] = tone_(m(c, 0) * r + m(c, 1) * g + m(c, 2) * b);
    }
  }
  return image;
}

cv::Mat CameraPipeline::image(cv::Mat& raw, const Development& development, std::uint64_t seed,
                              std::uint64_t frame) const {
  shade_lens(shading_, static_cast<float>(development.gain), raw);
  if (effects_.lens_blur_px > 0.0) gaussian_blur(raw, effects_.lens_blur_px);
  if (effects_.noise) raw = with_sensor_noise(raw, effects_, development.gain, seed, frame);
  const Eigen::Matrix3d colors = linear(development) / development.gain;
  return to_bytes(raw, colors);
}

cv::Mat CameraPipeline::clear_image(cv::Mat& raw, const Development& development) const {
  if (effects_.lens_blur_px > 0.0) gaussian_blur(raw, effects_.lens_blur_px);
  return to_bytes(raw, linear(development));
}

cv::Scalar CameraPipeline::mean_behind_lens(const cv::Mat& raw) const {
  cv::Mat shading;
  cv::resize(shading_, shading, raw.size(), 0.0, 0.0, cv::INTER_AREA);
  cv::Mat behind = raw.clone();
  shade_lens(shading, 1.0F, behind);
  return cv::mean(behind);
}

}  // namespace apvi::sim
