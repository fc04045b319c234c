// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "gaussians/render/splat_math.hpp"

/// SSIM of one value, shared by both backends (Wang et al., "Image quality assessment", 2004).
namespace apvi::gaussians {

/// Half of the 11-tap Gaussian with sigma 1.5 px, center first; the full kernel sums to one.
inline constexpr double kSsimWeights[] = {0.2660117248617943,   0.21300553771125366,
                                          0.1093606895097,      0.03600077212843082,
                                          0.007598758135239184, 0.0010283800844791099};

inline constexpr double kSsimC1 = 0.01 * 0.01;
inline constexpr double kSsimC2 = 0.03 * 0.03;

/// SSIM of one value and its derivatives, from the blurred s = x + y, d = x - y, s², d². With P =
/// s̄², Q = d̄², U = blur(s²) - P and V = blur(d²) - Q:
///
///     ((P - Q)/2 + c1) ((U - V)/2 + c2) / (((P + Q)/2 + c1) ((U + V)/2 + c2)).
template <typename T>
struct Ssim {
  T value, d_mean, d_ss, d_dd;

  // Always inlined: the CPU loops are compiled for several instruction sets.
  __attribute__((always_inline)) APVI_HD inline Ssim(T s, T d, T ss, T dd) {
    const T p = s * s;
    const T q = d * d;
    const T u = ss - p;
    const T v = dd - q;
    const T c1 = static_cast<T>(kSsimC1);
    const T c2 = static_cast<T>(kSsimC2);
    const T inverse_1 = T(1) / (T(0.5) * (p + q) + c1);
    const T inverse_2 = T(1) / (T(0.5) * (u + v) + c2);
    const T luminance = (T(0.5) * (p - q) + c1) * inverse_1;
    const T contrast = (T(0.5) * (u - v) + c2) * inverse_2;
    value = luminance * contrast;
    d_ss = T(0.5) * (luminance - value) * inverse_2;
    d_dd = T(-0.5) * (luminance + value) * inverse_2;
    const T d_p = T(0.5) * (contrast - value) * inverse_1 - d_ss;
    const T d_q = T(-0.5) * (contrast + value) * inverse_1 - d_dd;
    d_mean = T(2) * (s * d_p + d * d_q);
  }
};

}  // namespace apvi::gaussians
