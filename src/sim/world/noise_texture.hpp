// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <bit>
#include <cstdint>

/// Procedural 3-D noise based on integer hashing: no tables, no state, identical on every thread.
/// Kernels work on batches of points so that loops vectorize; the widest available instruction set
/// is selected at load time and does not change the results.
namespace apvi::sim {

inline constexpr int kBatch = 256;
/// One value for each point of a batch.
struct alignas(64) Lanes {
  float v[kBatch];
  float& operator[](int i) { return v[i]; }
  float operator[](int i) const { return v[i]; }
  void fill(float value) {
    for (float& x : v) x = value;
  }
};

struct Points {     // NOLINT(cppcoreguidelines-pro-type-member-init): scratch, filled before use
  Lanes x, y, z;    ///< [m]
  Lanes footprint;  ///< size of a pixel on the surface [m]: finer detail is filtered out
  int count = 0;
};

/// Weight of an octave after filtering to the pixel footprint: 1 below a quarter of a wavelength
/// per footprint, 0 above 0.6.
inline float octave_weight(float footprint, float frequency) {
  const float t = (0.6F - footprint * frequency) * (1.0F / 0.35F);
  return t < 0.0F ? 0.0F : (t > 1.0F ? 1.0F : t);
}

/// Fractal Brownian motion: a sum of gradient noise octaves (Perlin 2002 with hashed gradients).
/// The first octave has the wavelength 1 / frequency [m]; each next one has about half the
/// wavelength and `gain` times the amplitude. Octaves fade out where their wavelength drops below
/// two footprints.
struct Fbm {
  float frequency = 1.0F;
  int octaves = 4;
  float gain = 0.5F;
  std::uint32_t seed = 0;
  std::array<float, 3> stretch{1.0F, 1.0F, 1.0F};  ///< factors applied to x, y, z first
};

/// Values approximately in [-1, 1] (sigma near 0.3 for one octave).
void fbm(const Points& p, const Fbm& spec, Lanes& out);
/// As above, and the variance of the filtered-out octaves.
void fbm(const Points& p, const Fbm& spec, Lanes& out, Lanes& lost_variance);
/// As above for one point, without filtering.
float fbm(const Eigen::Vector3f& p, const Fbm& spec);

/// Value and its gradient [1/m], for bump mapping.
struct Gradient {
  Lanes value, dx, dy, dz;
  Lanes lost_variance;  ///< gradient variance per axis of the filtered-out octaves [1/m^2]
};
void fbm_gradient(const Points& p, const Fbm& spec, Gradient& out);

/// Cellular noise with one random point per cell (Worley 1996); distances in units of a cell.
struct Cells {
  Lanes nearest;     ///< distance to the nearest point
  Lanes border;      ///< distance to the second nearest minus `nearest`: 0 on cell borders
  Lanes id;          ///< random in [0, 1), constant over a cell
  Lanes dx, dy, dz;  ///< from the nearest point to this point, in cells
  Lanes weight;      ///< 1, fading to 0 where cells become smaller than two footprints
};
void cells(const Points& p, float frequency, std::uint32_t seed, Cells& out);

/// Hashes a counter to 32 random bits.
inline std::uint32_t hash32(std::uint32_t x) {  // "lowbias32", Wellons 2018
  x ^= x >> 16;
  x *= 0x7feb352dU;
  x ^= x >> 15;
  x *= 0x846ca68bU;
  x ^= x >> 16;
  return x;
}
inline std::uint32_t hash32(std::uint32_t a, std::uint32_t b) {
  return hash32(a ^ hash32(b));
}
/// Uniform in [0, 1) from 32 random bits.
inline float unit_float(std::uint32_t h) {
  return static_cast<float>(h >> 8) * 0x1.0p-24F;
}

/// exp(x) with a relative error of 2e-7 for x in [-87, 87]; bit-identical on every machine.
inline float fast_exp(float x) {
  x = x < -87.0F ? -87.0F : (x > 87.0F ? 87.0F : x);
  const float t = x * 1.44269504F;
  const int whole = static_cast<int>(t + (t < 0.0F ? -0.5F : 0.5F));
  const float f =
      (x - static_cast<float>(whole) * 0.693359375F) + static_cast<float>(whole) * 2.12194440e-4F;
  const float p =
      1.0F + f * (1.0F + f * (0.5F + f * (0.16666667F +
                                          f * (0.041666668F + f * (0.0083334F + f * 0.0013889F)))));
  return p * std::bit_cast<float>((whole + 127) << 23);
}

/// 0 below `low`, 1 above `high`, cubic in between.
inline float smooth_step(float low, float high, float x) {
  float t = (x - low) / (high - low);
  t = t < 0.0F ? 0.0F : (t > 1.0F ? 1.0F : t);
  return t * t * (3.0F - 2.0F * t);
}
/// Expected value of the step for an x with that variance: a wider step.
inline float smooth_step(float low, float high, float x, float variance) {
  const float width = high - low;  // a step is the integral of a bump of variance width^2 / 20
  const float wider = 0.5F * (__builtin_sqrtf(width * width + 20.0F * variance) - width);
  return smooth_step(low - wider, high + wider, x);
}
inline float mix(float a, float b, float t) {
  return a + (b - a) * t;
}

}  // namespace apvi::sim
