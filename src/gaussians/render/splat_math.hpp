// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

/// Scalar arithmetic shared by the CPU and CUDA backends: no LibTorch, no allocation.
#ifdef __CUDACC__
#define APVI_HD __host__ __device__
#else
#define APVI_HD
#endif

namespace apvi::gaussians {

/// Conventions of both rasterizers. A splat contributes to a pixel where its alpha reaches
/// kMinAlpha; alpha is clamped at kMaxAlpha; a pixel stops before the splat that would take its
/// transmittance down to kMinTransmittance. Splats are blended by depth, those of equal depth by
/// index.
inline constexpr double kMinAlpha = 1.0 / 255.0;
inline constexpr double kLog2MinAlpha = -7.994353436858858;
inline constexpr double kMaxAlpha = 0.999;
inline constexpr double kMinTransmittance = 1e-4;
/// How far outside the image the projection is linearized, as a fraction of half the image size.
inline constexpr double kFieldMargin = 0.3;
inline constexpr int kTileSize = 16;  ///< [px]

template <typename T>
APVI_HD inline T clamp_min(T x, T low) {
  return x < low ? low : x;
}
template <typename T>
APVI_HD inline T clamp_max(T x, T high) {
  return x > high ? high : x;
}
/// `value` where low <= x <= high, else 0.
template <typename T>
APVI_HD inline T where_between(T x, T low, T high, T value) {
  return x >= low && x <= high ? value : T(0);
}

/// Medium parameters of one color channel.
template <typename T>
struct ChannelMedium {
  T beta_d;  ///< attenuation of the direct light [1/m]
  T beta_b;  ///< backscatter coefficient [1/m]
  T b_inf;   ///< veiling light: color of an infinite water column, in [0, 1]
};

/// One channel of one pixel as the renderer outputs it.
template <typename T>
struct ChannelPixel {
  T color;  ///< without medium, premultiplied by alpha
  T range;  ///< distance to the surface [m]
  T alpha;  ///< opacity, in [0, 1]
};

/// Image formation model of the paper, Eq. (8), for a pixel that may be partly transparent:
///
///     I = C exp(-beta_d z) + B (1 - alpha exp(-beta_b z)).
///
/// With alpha = 1 it reduces to the paper's form; with C = alpha = 0 it is the veiling light.
template <typename T>
APVI_HD inline T medium_forward(const ChannelPixel<T>& p, const ChannelMedium<T>& m) {
  return p.color * std::exp(-m.beta_d * p.range) +
         m.b_inf * (T(1) - p.alpha * std::exp(-m.beta_b * p.range));
}

/// Derivatives of `medium_forward`, each times `grad`, the derivative of the loss with respect to
/// I.
template <typename T>
struct ChannelGradient {
  ChannelPixel<T> pixel;
  ChannelMedium<T> medium;
};
template <typename T>
APVI_HD inline ChannelGradient<T> medium_backward(const ChannelPixel<T>& p,
                                                  const ChannelMedium<T>& m, T grad) {
  const T direct = std::exp(-m.beta_d * p.range);
  const T blocked =
      p.alpha * std::exp(-m.beta_b * p.range);  // fraction of the backscatter behind the surface
  ChannelGradient<T> g = {};
  g.pixel.color = grad * direct;
  g.pixel.range = grad * (m.b_inf * m.beta_b * blocked - m.beta_d * p.color * direct);
  g.pixel.alpha = -grad * m.b_inf * std::exp(-m.beta_b * p.range);
  g.medium.beta_d = -grad * p.range * p.color * direct;
  g.medium.beta_b = grad * m.b_inf * p.range * blocked;
  g.medium.b_inf = grad * (T(1) - blocked);
  return g;
}

/// Lamp backscatter in front of a camera as computed by lamp_backscatter_table: at nodes spread
/// over the image from edge to edge, and at steps along the range.
template <typename T>
struct BackscatterTable {
  const T* values;  ///< [3,steps,nodes,nodes]; null: no lamp
  int steps;
  int nodes;
  T reach_m;  ///< range of the last step
};

/// Range up to which a pixel's backscatter is integrated: where nothing is rendered the ray
/// continues through water.
template <typename T>
APVI_HD inline T backscatter_range(const BackscatterTable<T>& table, T range, T alpha) {
  return alpha < T(0.5) ? table.reach_m : range;
}

/// A position between the nodes of a BackscatterTable: the preceding corner and the fractions
/// toward the next node along, across and down.
template <typename T>
struct BackscatterPosition {
  int corner;
  T along, across, down;
};
/// At `x`, `y` (0 to 1 over the image) and a range [m]. Steps are spaced quadratically in range. A
/// NaN range counts as zero.
template <typename T>
APVI_HD inline BackscatterPosition<T> backscatter_position(const BackscatterTable<T>& table, T x,
                                                           T y, T range) {
  const T part = range > T(0) ? clamp_max(range / table.reach_m, T(1)) : T(0);
  const T step = std::sqrt(part) * static_cast<T>(table.steps - 1);
  const T column = x * static_cast<T>(table.nodes - 1);
  const T row = y * static_cast<T>(table.nodes - 1);
  const int s = clamp_max(static_cast<int>(step), table.steps - 2);
  const int c = clamp_max(static_cast<int>(column), table.nodes - 2);
  const int r = clamp_max(static_cast<int>(row), table.nodes - 2);
  return {(s * table.nodes + r) * table.nodes + c, step - static_cast<T>(s),
          column - static_cast<T>(c), row - static_cast<T>(r)};
}
/// One channel of the table at a position, interpolated trilinearly.
template <typename T>
APVI_HD inline T backscatter_at(const BackscatterTable<T>& table, int channel,
                                const BackscatterPosition<T>& place) {
  const int layer = table.nodes * table.nodes;
  const T* const v = table.values + channel * table.steps * layer + place.corner;
  const auto between = [&](const T* p) {
    const T above = p[0] + place.across * (p[1] - p[0]);
    const T below = p[table.nodes] + place.across * (p[table.nodes + 1] - p[table.nodes]);
    return above + place.down * (below - above);
  };
  const T near = between(v);
  return near + place.along * (between(v + layer) - near);
}

}  // namespace apvi::gaussians
