// SPDX-License-Identifier: BSD-3-Clause
#include "sim/render/camera_effects.hpp"

#include <algorithm>
#include <cmath>

#include "sim/world/clones.hpp"
#include "sim/world/noise_texture.hpp"

namespace apvi::sim {
namespace {

// Sum of four uniform numbers, shifted and scaled: mean 0, sigma 1, tails end at 3.5 sigma. A good
// approximation of a normal distribution for pixel noise, and bit-identical on every machine.
inline float approximate_normal(std::uint32_t key) {
  const std::uint32_t a = hash32(key);
  const std::uint32_t b = hash32(key ^ 0x68bc21ebU);
  const int sum = static_cast<int>((a & 0xffffU) + (a >> 16) + (b & 0xffffU) + (b >> 16));
  return static_cast<float>(sum - 131070) *
         (1.0F / 37837.0F);  // sigma of the sum: 65536 sqrt(4/12)
}

// Shot noise (variance equals the electron count) plus read noise.
APVI_CLONES void add_noise(const float* in, float* out, int count, float electrons,
                           float read_noise, std::uint32_t key) {
  for (int i = 0; i < count; ++i) {
    const float light = in[i] > 0.0F ? in[i] : 0.0F;
    const float sigma = __builtin_sqrtf(light * electrons + read_noise * read_noise) / electrons;
    out[i] = in[i] + sigma * approximate_normal(key + static_cast<std::uint32_t>(i));
  }
}

APVI_CLONES void to_bytes(const float* in, std::uint8_t* out, int count) {
  for (int i = 0; i < count; ++i) {
    float x = in[i] * 255.0F + 0.5F;
    x = x < 0.0F ? 0.0F : (x > 255.0F ? 255.0F : x);
    out[i] = static_cast<std::uint8_t>(static_cast<int>(x));
  }
}

void apply_response(float* row, int count, double gamma) {
  if (gamma == 1.0) return;
  const auto power = static_cast<float>(1.0 / gamma);
  for (int i = 0; i < count; ++i) row[i] = std::pow(std::clamp(row[i], 0.0F, 1.0F), power);
}

// out = side * (before + after) + middle * here
APVI_CLONES void three_taps(const float* before, const float* here, const float* after, float* out,
                            int count, float side, float middle) {
  for (int i = 0; i < count; ++i) {
    out[i] = side * (before[i] + after[i]) + middle * here[i];
  }
}

}  // namespace

void gaussian_blur(cv::Mat& image, double sigma) {
  const double neighbor = std::exp(-0.5 / (sigma * sigma));
  const auto side = static_cast<float>(neighbor / (1.0 + 2.0 * neighbor));
  const float middle = 1.0F - 2.0F * side;
  const int last = image.rows - 1;
  const int width = 3 * image.cols;
  cv::Mat columns(image.size(), CV_32FC3);
  for (int y = 0; y <= last; ++y) {
    three_taps(image.ptr<float>(std::max(0, y - 1)), image.ptr<float>(y),
               image.ptr<float>(std::min(last, y + 1)), columns.ptr<float>(y), width, side, middle);
  }
  for (int y = 0; y <= last; ++y) {  // the first and last columns stay unchanged
    const float* in = columns.ptr<float>(y);
    float* out = image.ptr<float>(y);
    std::copy_n(in, 3, out);
    std::copy_n(in + width - 3, 3, out + width - 3);
    three_taps(in, in + 3, in + 6, out + 3, width - 6, side, middle);
  }
}

cv::Mat with_sensor_noise(const cv::Mat& linear, const CameraEffectsConfig& config, double gain,
                          std::uint64_t seed, std::uint64_t frame) {
  cv::Mat noisy(linear.size(), CV_32FC3);
  const auto electrons = static_cast<float>(config.full_well_e / gain);
  const std::uint32_t stream =
      hash32(static_cast<std::uint32_t>(seed ^ (seed >> 32)),
             hash32(static_cast<std::uint32_t>(frame), static_cast<std::uint32_t>(frame >> 32)));
  for (int y = 0; y < linear.rows; ++y) {
    add_noise(linear.ptr<float>(y), noisy.ptr<float>(y), 3 * linear.cols, electrons,
              static_cast<float>(config.read_noise_e),
              hash32(stream, static_cast<std::uint32_t>(y)));
  }
  return noisy;
}

cv::Mat simulate_sensor(const cv::Mat& linear, const CameraEffectsConfig& config, double gain,
                        std::uint64_t seed, std::uint64_t frame) {
  if (!config.noise) return simulate_noiseless_sensor(linear, config);
  return simulate_noiseless_sensor(with_sensor_noise(linear, config, gain, seed, frame), config);
}

cv::Mat simulate_noiseless_sensor(const cv::Mat& linear, const CameraEffectsConfig& config) {
  cv::Mat image(linear.size(), CV_8UC3);
  const int count = 3 * linear.cols;
  cv::Mat row(1, linear.cols, CV_32FC3);
  for (int y = 0; y < linear.rows; ++y) {
    std::copy_n(linear.ptr<float>(y), count, row.ptr<float>());
    apply_response(row.ptr<float>(), count, config.gamma);
    to_bytes(row.ptr<float>(), image.ptr<std::uint8_t>(y), count);
  }
  return image;
}

}  // namespace apvi::sim
