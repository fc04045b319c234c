// SPDX-License-Identifier: BSD-3-Clause
#include "cpu_fallback/depth/sweep_patch.hpp"

#include <algorithm>
#include <cmath>

/// As in clones.hpp, but including integer vector instructions.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define APVI_SWEEP_CLONES \
  __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define APVI_SWEEP_CLONES
#endif

namespace apvi::depth::cpu {
namespace {

struct SampleOffsets {
  alignas(64) std::array<float, kSamples> x;
  alignas(64) std::array<float, kSamples> y;
};

constexpr SampleOffsets make_sample_offsets() {
  SampleOffsets places = {};
  std::size_t k = 0;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) {
      if ((row == 0 || row == 5) && (column == 0 || column == 5)) continue;
      places.x[k] = static_cast<float>(column) - kPatchReach;
      places.y[k] = static_cast<float>(row) - kPatchReach;
      ++k;
    }
  }
  return places;
}

constexpr SampleOffsets kSampleOffsets = make_sample_offsets();
constexpr std::array<std::size_t, 4> kCenterSamples = {12, 13, 18, 19};  // the four center samples

__attribute__((always_inline)) inline void sample_bilinear(const Level& level,
                                                           const PatchTransform& p,
                                                           float* __restrict__ samples) {
  for (std::size_t k = 0; k < kSamples; ++k) {
    const float x = p.x + p.xx * kSampleOffsets.x[k] + p.xy * kSampleOffsets.y[k];
    const float y = p.y + p.yx * kSampleOffsets.x[k] + p.yy * kSampleOffsets.y[k];
    const int column = static_cast<int>(x);
    const int row = static_cast<int>(y);
    const float right = x - static_cast<float>(column);
    const float down = y - static_cast<float>(row);
    const int i = row * level.width + column;
    const std::uint32_t a = level.pairs[i];
    const std::uint32_t b = level.pairs[i + 1];
    const auto a0 = static_cast<float>(static_cast<int>(a & 0xFFFFU));
    const auto a1 = static_cast<float>(static_cast<int>(a >> 16U));
    const auto b0 = static_cast<float>(static_cast<int>(b & 0xFFFFU));
    const auto b1 = static_cast<float>(static_cast<int>(b >> 16U));
    const float above = a0 + right * (b0 - a0);
    const float below = a1 + right * (b1 - a1);
    samples[k] = above + down * (below - above);
  }
}

}  // namespace

APVI_SWEEP_CLONES Patch sample_patch(const Level& level, const PatchTransform& place, float noise,
                                     float sigma) {
  Patch patch = {};
  sample_bilinear(level, place, patch.values.data());
  float middle = 0.0F;
  for (const std::size_t k : kCenterSamples) middle += patch.values[k] / kCenterSamples.size();
  float plain = 0.0F;
  for (const float value : patch.values) plain += value / kSamples;
  float variance = 0.0F;
  for (const float value : patch.values) variance += (value - plain) * (value - plain) / kSamples;
  const float unit = std::max(sigma, std::sqrt(variance));
  float all = 0.0F;
  float sum = 0.0F;
  for (std::size_t k = 0; k < kSamples; ++k) {
    patch.weights[k] = std::exp(-std::fabs(patch.values[k] - middle) / unit);
    all += patch.weights[k];
    sum += patch.weights[k] * patch.values[k];
  }
  patch.mean = sum / all;
  float squares = 0.0F;
  for (std::size_t k = 0; k < kSamples; ++k) {
    patch.weights[k] *= kSamples / all;
    patch.values[k] -= patch.mean;
    squares += patch.weights[k] * patch.values[k] * patch.values[k];
  }
  patch.noise_sum = kSamples * noise * noise;
  patch.inverse_norm = 1.0F / std::sqrt(squares + patch.noise_sum);
  return patch;
}

APVI_SWEEP_CLONES float correlation_cost(const Patch& patch, const Level& level,
                                         const PatchTransform& place) {
  alignas(64) std::array<float, kSamples> samples;  // NOLINT(*-member-init)
  sample_bilinear(level, place, samples.data());
  float sum = 0.0F;
  float squares = 0.0F;
  float products = 0.0F;
  for (std::size_t k = 0; k < kSamples; ++k) {
    const float value = samples[k] - patch.mean;  // small magnitudes preserve precision
    const float weighted = patch.weights[k] * value;
    sum += weighted;
    squares += weighted * value;
    products += weighted * patch.values[k];
  }
  const float spread = squares - sum * sum / kSamples;
  const float correlation =
      products * patch.inverse_norm / std::sqrt((spread > 0.0F ? spread : 0.0F) + patch.noise_sum);
  return correlation > 0.0F ? 1.0F - correlation : 1.0F;
}

APVI_SWEEP_CLONES float difference_cost(const Patch& patch, const Level& level,
                                        const PatchTransform& place, float gain, float offset) {
  alignas(64) std::array<float, kSamples> samples;  // NOLINT(*-member-init)
  sample_bilinear(level, place, samples.data());
  const float mean = gain * patch.mean + offset;
  float sum = 0.0F;
  for (std::size_t k = 0; k < kSamples; ++k) {
    sum += patch.weights[k] * std::fabs(samples[k] - mean - gain * patch.values[k]);
  }
  return sum / kSamples;
}

}  // namespace apvi::depth::cpu
