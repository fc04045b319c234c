// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

#include "apvi/splat/projection_math.hpp"

/// A Gaussian as the rasterizers draw it, and back from what its pixels say. T is a scalar or a
/// vector of scalars.
namespace apvi::splat {

inline constexpr double kLog2E = 1.4426950408889634;
inline constexpr double kLn2 = 0.6931471805599453;

/// A projected Gaussian; in float one cache line. At the pixel (x, y), with dx = x - u, dy = y - v:
/// log2(alpha) = e_0 + e_xx dx² + e_xy dx dy + e_yy dy².
template <typename T>
struct alignas(64) Splat {
  T u, v;
  T e_0, e_xx, e_xy, e_yy;
  T color[3];
  T z;
  // The ellipse on which alpha is kMinAlpha (a hair larger): at the height dy its x spans
  // u + slope dy ± half sqrt(reach_y2 - dy²).
  T slope, half, reach_y2;
  T reach_x;  // its half width
  T lean;     // dy of its rightmost point; that of the leftmost is the negative
  T radius;   // its larger half axis; 0 for a Gaussian that is not drawn
};

/// Derivatives of the loss in a slot: by the colour, by the depth, then sums over the pixels of the
/// derivative by ln(alpha) times 1, dx, dx², dy, dy², dx dy.
inline constexpr int kSlotSize = 12;

/// The footprint's fields of `Splat`, in the order in which they stand there (colours are left
/// out); whether it may show in an image of `width` x `height` px.
template <typename V>
APVI_HD inline auto describe(const Camera<V>& camera, const Projection<V>& f, V opacity, V width,
                             V height, V* out) {
  using std::fma;
  using std::log2;
  using std::sqrt;
  const V log2_opacity = log2(opacity);
  const V inv_det = V(1) / f.det;
  // A hair more than where alpha reaches kMinAlpha: the blending decides, this may not lose any.
  const V reach2 = fma(log2_opacity - V(kLog2MinAlpha), V(2 * kLn2), V(1e-3));
  const V reach_x = sqrt(reach2 * f.a);
  const V reach_y2 = reach2 * f.c;
  const V reach_y = sqrt(reach_y2);
  const V middle = V(0.5) * (f.a + f.c);
  const V spread = V(0.5) * (f.a - f.c);
  out[0] = f.u;
  out[1] = f.v;
  out[2] = log2_opacity;
  out[3] = V(-0.5 * kLog2E) * f.c * inv_det;
  out[4] = V(kLog2E) * f.b * inv_det;
  out[5] = V(-0.5 * kLog2E) * f.a * inv_det;
  out[9] = f.p[2];
  out[10] = f.b / f.c;
  out[11] = sqrt(f.det) / f.c;
  out[12] = reach_y2;
  out[13] = reach_x;
  out[14] = reach_x * f.b / f.a;
  out[15] = sqrt(reach2 * (middle + sqrt(fma(spread, spread, f.b * f.b))));
  // False for NaN throughout.
  const V huge(1e30);
  return (f.p[2] >= camera.near_m) & (opacity >= V(kMinAlpha)) & (f.det > V(0)) & (out[15] < huge) &
         (inv_det < huge) & (f.u + reach_x > V(0)) & (f.u - reach_x < width) &
         (f.v + reach_y > V(0)) & (f.v - reach_y < height);
}

/// First and last pixel whose centre lies in a range; empty when first > last.
struct PixelSpan {
  int first, last;
};
template <typename T>
APVI_HD inline PixelSpan pixels_between(T low, T high, int size) {
  const T half(0.5);
  const auto end = static_cast<T>(size);
  return {static_cast<int>(std::ceil(at_most(at_least(low - half, T(0)), end))),
          static_cast<int>(std::floor(at_most(at_least(high - half, T(-1)), end - T(1))))};
}

/// Rows of the image that the ellipse of a splat touches. T is a scalar here and in what follows.
template <typename T>
APVI_HD inline PixelSpan rows_of(const Splat<T>& s, int height) {
  const T reach_y = std::sqrt(s.reach_y2);
  return pixels_between(s.v - reach_y, s.v + reach_y, height);
}

/// Columns that it touches between the centres of two rows.
template <typename T>
APVI_HD inline PixelSpan columns_of(const Splat<T>& s, int top, int bottom, int width) {
  const T low = static_cast<T>(top) + T(0.5) - s.v;
  const T high = static_cast<T>(bottom) + T(0.5) - s.v;
  const T right = at_most(at_least(s.lean, low), high);
  const T left = at_most(at_least(-s.lean, low), high);
  const T half_right = s.half * std::sqrt(at_least(s.reach_y2 - right * right, T(0)));
  const T half_left = s.half * std::sqrt(at_least(s.reach_y2 - left * left, T(0)));
  return pixels_between(s.u + s.slope * left - half_left, s.u + s.slope * right + half_right,
                        width);
}

/// Tile columns that it touches in a band of tiles; `rows` as `rows_of` gave them.
template <typename T>
APVI_HD inline PixelSpan tiles_in_band(const Splat<T>& s, PixelSpan rows, int band, int width) {
  const int top = at_least(rows.first, band * kTileSize);
  const int bottom = at_most(rows.last, band * kTileSize + kTileSize - 1);
  const PixelSpan columns = columns_of(s, top, bottom, width);
  if (columns.first > columns.last) return {0, -1};
  return {columns.first / kTileSize, columns.last / kTileSize};
}

/// By the footprint, from the sums over its pixels (see kSlotSize).
template <typename V>
APVI_HD inline FootprintGradient<V> footprint_gradient(const Camera<V>& camera,
                                                       const Projection<V>& f, const V* sums,
                                                       bool antialiased) {
  const V inv_det = V(1) / f.det;
  const V A = f.c * inv_det;
  const V B = V(0) - f.b * inv_det;
  const V C = f.a * inv_det;
  const V xx = V(0.5) * sums[6];  // minus the derivatives by the conic [[A, B], [B, C]]
  const V yy = V(0.5) * sums[8];
  const V xy = sums[9];
  FootprintGradient<V> g = {};
  g.u = A * sums[5] + B * sums[7];
  g.v = B * sums[5] + C * sums[7];
  g.z = sums[3];
  g.a = A * A * xx + A * B * xy + B * B * yy;
  g.b = V(2) * (A * B * xx + B * C * yy) + (A * C + B * B) * xy;
  g.c = B * B * xx + B * C * xy + C * C * yy;
  if (antialiased) {  // ln(opacity) + ln(det_sharp / det) / 2
    const V half = V(0.5) * sums[4];
    const V sharp = half / f.det_sharp;
    const V blunt = half * inv_det;
    g.a = g.a + sharp * (f.c - camera.low_pass) - blunt * f.c;
    g.b = g.b - V(2) * f.b * (sharp - blunt);
    g.c = g.c + sharp * (f.a - camera.low_pass) - blunt * f.a;
  }
  return g;
}

/// Unit vector from the camera to the Gaussian, in the world, and the distance's inverse.
template <typename V>
APVI_HD inline V view_direction(const Camera<V>& camera, const V* mean, V* direction) {
  using std::fma;
  using std::sqrt;
  V norm2(0);
  for (int i = 0; i < 3; ++i) {
    direction[i] = mean[i] - camera.center[i];
    norm2 = fma(direction[i], direction[i], norm2);
  }
  const V inverse = V(1) / sqrt(norm2);
  for (int i = 0; i < 3; ++i) direction[i] = direction[i] * inverse;
  return inverse;
}

}  // namespace apvi::splat
