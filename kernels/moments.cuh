// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_bf16.h>

#include "adam.hpp"

/// Adam's arithmetic on one value, and how moments lie in memory: as floats, or cut to the upper
/// half of a float. Values cut are rounded up or down at random, with the odds that keep their mean
/// (Gupta et al., "Deep learning with limited numerical precision", 2015): the second moment
/// changes by a thousandth in a step, which rounding to the nearest would never let through. What
/// is random depends on the value's place and the step alone, so that the same steps give the same
/// bits.
namespace apvi::splat::cuda {

inline constexpr int kVector = 4;  // values that a thread moves at once

template <typename T>
struct alignas(kVector * sizeof(T)) Vector {
  T x[kVector];
};
template <typename T>
__device__ inline Vector<T> load_vector(const T* from, int count) {
  if (count == kVector) return *reinterpret_cast<const Vector<T>*>(from);
  Vector<T> out = {};
  for (int k = 0; k < count; ++k) out.x[k] = from[k];
  return out;
}
template <typename T>
__device__ inline void store_vector(const Vector<T>& v, T* to, int count) {
  if (count == kVector) {
    *reinterpret_cast<Vector<T>*>(to) = v;
    return;
  }
  for (int k = 0; k < count; ++k) to[k] = v.x[k];
}

using Half = __nv_bfloat16_raw;

__device__ inline float widen(float x) {
  return x;
}
__device__ inline float widen(Half x) {
  return __uint_as_float(static_cast<unsigned>(x.x) << 16);
}

/// Of `random`, the lower half is used.
__device__ inline void narrow(float x, unsigned /*random*/, float& to) {
  to = x;
}
__device__ inline void narrow(float x, unsigned random, Half& to) {
  unsigned bits = __float_as_uint(x);
  if ((bits & 0x7f800000U) != 0x7f800000U) bits += random & 0xffffU;
  to.x = static_cast<unsigned short>(bits >> 16);
}

/// Jarzynski and Olano, "Hash functions for GPU rendering", 2020: PCG.
__device__ inline unsigned scramble(unsigned x) {
  const unsigned state = x * 747796405U + 2891336453U;
  const unsigned word = ((state >> ((state >> 28U) + 4U)) ^ state) * 277803737U;
  return (word >> 22U) ^ word;
}

/// One step of one value; `place` tells it from all others.
template <typename Moment>
__device__ inline void step_value(float& parameter, float g, Moment& first, Moment& second,
                                  float rate, const AdamFactors& f, unsigned place) {
  const float m = f.keep_first * widen(first) + (1.0f - f.keep_first) * g;
  const float v = f.keep_second * widen(second) + (1.0f - f.keep_second) * g * g;
  float root;
  asm("sqrt.approx.f32 %0, %1;" : "=f"(root) : "f"(v));
  parameter -= __fdividef(rate * m, root * f.root_scale + f.epsilon);
  const unsigned random = sizeof(Moment) < sizeof(float) ? scramble(place ^ f.seed) : 0U;
  narrow(m, random, first);
  narrow(v, random >> 16U, second);
}

}  // namespace apvi::splat::cuda
