// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

/// Scalar arithmetic that the CPU and the CUDA backend share: no LibTorch, no allocation.
#ifdef __CUDACC__
#define APVI_HD __host__ __device__
#else
#define APVI_HD
#endif

namespace apvi::splat {

/// What both rasterizers agree on. A splat is drawn where its opacity reaches kMinAlpha, opacity is
/// cut at kMaxAlpha, and a pixel is finished before the splat that would take its transmittance to
/// kMinTransmittance. Splats are drawn by depth, those of equal depth by index.
inline constexpr double kMinAlpha = 1.0 / 255.0;
inline constexpr double kLog2MinAlpha = -7.994353436858858;
inline constexpr double kMaxAlpha = 0.999;
inline constexpr double kMinTransmittance = 1e-4;
/// The projection is linearised at most so far outside the image, in parts of half its size.
inline constexpr double kFieldMargin = 0.3;
inline constexpr int kTileSize = 16;  ///< [px]

template <typename T>
APVI_HD inline T at_least(T x, T low) {
  return x < low ? low : x;
}
template <typename T>
APVI_HD inline T at_most(T x, T high) {
  return x > high ? high : x;
}
/// `value` where low <= x <= high, else 0.
template <typename T>
APVI_HD inline T where_between(T x, T low, T high, T value) {
  return x >= low && x <= high ? value : T(0);
}

/// Water seen through one colour channel.
template <typename T>
struct ChannelMedium {
  T beta_d;  ///< attenuation of the direct light [1/m]
  T beta_b;  ///< growth of the backscatter [1/m]
  T b_inf;   ///< colour of water without end, in [0, 1]
};

/// One pixel of one channel as the renderer delivers it.
template <typename T>
struct ChannelPixel {
  T color;  ///< without water; weighted by alpha already
  T range;  ///< distance to the surface [m]
  T alpha;  ///< opacity, in [0, 1]
};

/// The paper's image formation, Eq. (8), for a pixel that may be partly empty:
///
///     I = C exp(-beta_d z) + B (1 - alpha exp(-beta_b z)).
///
/// With alpha = 1 it is what the paper prints; where nothing is, C = alpha = 0 and the water
/// remains.
template <typename T>
APVI_HD inline T medium_forward(const ChannelPixel<T>& p, const ChannelMedium<T>& m) {
  return p.color * std::exp(-m.beta_d * p.range) +
         m.b_inf * (T(1) - p.alpha * std::exp(-m.beta_b * p.range));
}

/// Derivatives of `medium_forward`, each times `grad`, the derivative of the loss by I.
template <typename T>
struct ChannelGradient {
  ChannelPixel<T> pixel;
  ChannelMedium<T> medium;
};
template <typename T>
APVI_HD inline ChannelGradient<T> medium_backward(const ChannelPixel<T>& p,
                                                  const ChannelMedium<T>& m, T grad) {
  const T direct = std::exp(-m.beta_d * p.range);
  const T veil = p.alpha * std::exp(-m.beta_b * p.range);  // how much of the water is in front
  ChannelGradient<T> g = {};
  g.pixel.color = grad * direct;
  g.pixel.range = grad * (m.b_inf * m.beta_b * veil - m.beta_d * p.color * direct);
  g.pixel.alpha = -grad * m.b_inf * std::exp(-m.beta_b * p.range);
  g.medium.beta_d = -grad * p.range * p.color * direct;
  g.medium.beta_b = grad * m.b_inf * p.range * veil;
  g.medium.b_inf = grad * (T(1) - veil);
  return g;
}

}  // namespace apvi::splat
