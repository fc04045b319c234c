// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <bit>
#include <cstdint>

/// Procedural noise in three dimensions by integer hashing: no tables, no state, the same numbers
/// on every thread. Kernels work on batches of points so that the compiler can use wide registers;
/// the widest set of instructions is chosen when the program starts and does not change the
/// results.
namespace apvi::sim {

inline constexpr int kBatch = 256;
/// One number for each point of a batch.
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
  Lanes footprint;  ///< size of a pixel on the surface [m]: detail finer than this is left out
  int count = 0;
};

/// How much of a wave is left in a pixel: all below a quarter of it a footprint, none above 0.6.
inline float visibility(float footprint, float frequency) {
  const float t = (0.6F - footprint * frequency) * (1.0F / 0.35F);
  return t < 0.0F ? 0.0F : (t > 1.0F ? 1.0F : t);
}

/// Fractal sum of gradient noise (Perlin 2002 with hashed gradients). Wavelength of the first
/// octave is 1 / frequency [m]; each next one has half the wavelength and `gain` times the
/// amplitude. Octaves fade out where their waves become smaller than two footprints.
struct Fbm {
  float frequency = 1.0F;
  int octaves = 4;
  float gain = 0.5F;
  std::uint32_t seed = 0;
  std::array<float, 3> stretch{1.0F, 1.0F, 1.0F};  ///< factors on x, y, z before everything
};

/// Values about in [-1, 1] (sigma near 0.3 for an octave).
void fbm(const Points& p, const Fbm& spec, Lanes& out);
/// The same with the variance of what is too fine to be seen.
void fbm(const Points& p, const Fbm& spec, Lanes& out, Lanes& faded);
/// The same for one point, without fading.
float fbm(const Eigen::Vector3f& p, const Fbm& spec);

/// Value and its gradient [1/m], for bumps.
struct Gradient {
  Lanes value, dx, dy, dz;
  Lanes faded;  ///< variance of the gradient along any axis by what is too fine to be seen [1/m^2]
};
void fbm_gradient(const Points& p, const Fbm& spec, Gradient& out);

/// One random point a cell (Worley 1996): distances in units of the cell.
struct Cells {
  Lanes nearest;     ///< distance to the nearest point
  Lanes border;      ///< distance to the second nearest minus that: 0 on the border of two cells
  Lanes id;          ///< random in [0, 1), the same over a cell
  Lanes dx, dy, dz;  ///< from the nearest point to here, in cells
  Lanes weight;      ///< 1, fading to 0 where cells become smaller than two footprints
};
void cells(const Points& p, float frequency, std::uint32_t seed, Cells& out);

/// Scrambles a counter into 32 random bits.
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

/// exp(x) to 2e-7 relative for x in [-87, 87]; the same bits everywhere.
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

/// 0 below `low`, 1 above `high`, smooth between.
inline float smooth_step(float low, float high, float x) {
  float t = (x - low) / (high - low);
  t = t < 0.0F ? 0.0F : (t > 1.0F ? 1.0F : t);
  return t * t * (3.0F - 2.0F * t);
}
/// Its mean where x is spread by that variance: the step becomes wider by as much.
inline float smooth_step(float low, float high, float x, float variance) {
  const float width = high - low;  // a step is the integral of a bump of variance width^2 / 20
  const float wider = 0.5F * (__builtin_sqrtf(width * width + 20.0F * variance) - width);
  return smooth_step(low - wider, high + wider, x);
}
inline float mix(float a, float b, float t) {
  return a + (b - a) * t;
}

}  // namespace apvi::sim
