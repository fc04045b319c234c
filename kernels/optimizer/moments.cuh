// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_bf16.h>

#include "kernels/optimizer/adam.hpp"

/// Adam arithmetic on one value, and storage of moments as float or bfloat16. bfloat16 values are
/// rounded stochastically to stay unbiased (Gupta et al., "Deep learning with limited numerical
/// precision", 2015): the second moment changes by a thousandth per step, which rounding to nearest
/// would drop. The random bits depend only on the value's index and the step, so results are
/// deterministic.
namespace apvi::gaussians::cuda {

inline constexpr int kVector = 4;  // values per vectorized load or store

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

__device__ inline float to_float(float x) {
  return x;
}
__device__ inline float to_float(Half x) {
  return __uint_as_float(static_cast<unsigned>(x.x) << 16);
}

/// Uses the lower 16 bits of `random`.
__device__ inline void round_to(float x, unsigned /*random*/, float& to) {
  to = x;
}
__device__ inline void round_to(float x, unsigned random, Half& to) {
  unsigned bits = __float_as_uint(x);
  if ((bits & 0x7f800000U) != 0x7f800000U) bits += random & 0xffffU;
  to.x = static_cast<unsigned short>(bits >> 16);
}

/// PCG hash (Jarzynski and Olano, "Hash functions for GPU rendering", 2020).
__device__ inline unsigned pcg_hash(unsigned x) {
  const unsigned state = x * 747796405U + 2891336453U;
  const unsigned word = ((state >> ((state >> 28U) + 4U)) ^ state) * 277803737U;
  return (word >> 22U) ^ word;
}

/// One step of one value; `index` identifies the value.
template <typename Moment>
__device__ inline void step_value(float& parameter, float g, Moment& first, Moment& second,
                                  float rate, const AdamFactors& f, unsigned index) {
  const float m = f.beta1 * to_float(first) + (1.0f - f.beta1) * g;
  const float v = f.beta2 * to_float(second) + (1.0f - f.beta2) * g * g;
  float root;
  asm("sqrt.approx.f32 %0, %1;" : "=f"(root) : "f"(v));
  parameter -= __fdividef(rate * m, root * f.root_scale + f.epsilon);
  const unsigned random = sizeof(Moment) < sizeof(float) ? pcg_hash(index ^ f.seed) : 0U;
  round_to(m, random, first);
  round_to(v, random >> 16U, second);
}

}  // namespace apvi::gaussians::cuda
