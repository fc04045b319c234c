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

/// What a lamp's light does in the water before a camera, as lamp_haze_table works it out: at nodes
/// spread over the picture from edge to edge, and in steps over the range.
template <typename T>
struct HazeTable {
  const T* values;  ///< [3,steps,nodes,nodes]; null: there is no lamp
  int steps;
  int nodes;
  T reach_m;  ///< range of the last step
};

/// Up to where the haze of a pixel counts: where nothing is drawn, its ray goes on through water.
template <typename T>
APVI_HD inline T haze_range(const HazeTable<T>& table, T range, T alpha) {
  return alpha < T(0.5) ? table.reach_m : range;
}

/// A place between the nodes of a HazeTable: the nearest corner before it, and how far it is on
/// the way to the next node along, across and down.
template <typename T>
struct HazePlace {
  int corner;
  T along, across, down;
};
/// At `x`, `y` (0 to 1 over the picture) and a range [m]. The steps grow with its square. A range
/// that is no number counts as none.
template <typename T>
APVI_HD inline HazePlace<T> haze_place(const HazeTable<T>& table, T x, T y, T range) {
  const T part = range > T(0) ? at_most(range / table.reach_m, T(1)) : T(0);
  const T step = std::sqrt(part) * static_cast<T>(table.steps - 1);
  const T column = x * static_cast<T>(table.nodes - 1);
  const T row = y * static_cast<T>(table.nodes - 1);
  const int s = at_most(static_cast<int>(step), table.steps - 2);
  const int c = at_most(static_cast<int>(column), table.nodes - 2);
  const int r = at_most(static_cast<int>(row), table.nodes - 2);
  return {(s * table.nodes + r) * table.nodes + c, step - static_cast<T>(s),
          column - static_cast<T>(c), row - static_cast<T>(r)};
}
/// One colour there.
template <typename T>
APVI_HD inline T haze_at(const HazeTable<T>& table, int channel, const HazePlace<T>& place) {
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

}  // namespace apvi::splat
