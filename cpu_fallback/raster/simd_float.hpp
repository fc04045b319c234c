// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Polynomials shared by the float vectors. V is the vector type.
namespace apvi::gaussians::simd {

/// 2^x on [-1/2, 1/2]: 1e-7 relative.
template <typename V>
V exp2_fraction(V x) {
  V y = fma(V(0.001339086336F), x, V(0.009676031918F));
  y = fma(y, x, V(0.05550357114F));
  y = fma(y, x, V(0.2402210749F));
  y = fma(y, x, V(0.693147188F));
  return fma(y, x, V(1.000000075F));
}

/// log2(1 + t) on [-1/4, 1/2]: 3e-8 relative.
template <typename V>
V log2_fraction(V t) {
  V y = fma(V(0.0763922376F), t, V(-0.172500522F));
  y = fma(y, t, V(0.2160132452F));
  y = fma(y, t, V(-0.242887751F));
  y = fma(y, t, V(0.2882365201F));
  y = fma(y, t, V(-0.3605715677F));
  y = fma(y, t, V(0.4809007924F));
  y = fma(y, t, V(-0.7213485109F));
  y = fma(y, t, V(1.442695038F));
  return y * t;
}

/// The bits of 3/4: subtracting them leaves whole powers of two above the mantissa, so that the
/// reduced argument is in [3/4, 3/2).
inline constexpr int kThreeQuarters = 0x3f400000;
inline constexpr int kMantissaBits = 23;

}  // namespace apvi::gaussians::simd
