// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

#include "gaussians/render/projection_math.hpp"

/// A projected Gaussian as the rasterizers blend it, and the backward pass from per-pixel sums. T
/// is a scalar or a vector of scalars.
namespace apvi::gaussians {

inline constexpr double kLog2E = 1.4426950408889634;
inline constexpr double kLn2 = 0.6931471805599453;

/// A projected Gaussian; one cache line in float. At pixel (x, y), with dx = x - u, dy = y - v:
/// log2(alpha) = e_0 + e_xx dx² + e_xy dx dy + e_yy dy².
template <typename T>
struct alignas(64) Splat {
  T u, v;
  T e_0, e_xx, e_xy, e_yy;
  T color[3];
  T z;
  // The ellipse where alpha = kMinAlpha (slightly enlarged): at the offset dy it spans u + slope dy
  // ± half sqrt(extent_y2 - dy²) in x.
  T slope, half, extent_y2;
  T extent_x;  // half width of the ellipse
  T tip_dy;    // dy of its rightmost point; minus that of the leftmost
  T radius;    // larger half axis; 0 for a Gaussian that is not visible
};

/// Values of a slot (one splat in one tile): derivatives of the loss by color and by depth, then
/// sums over the pixels of the derivative by ln(alpha) times 1, dx, dx², dy, dy², dx dy.
inline constexpr int kSlotSize = 12;

/// Computes the fields of `Splat` in their order, except the colors; returns whether the splat may
/// be visible in an image of `width` x `height` px.
template <typename V>
APVI_HD inline auto compute_splat(const Camera<V>& camera, const Projection<V>& f, V opacity,
                                  V width, V height, V* out) {
  using std::fma;
  using std::log2;
  using std::sqrt;
  const V log2_opacity = log2(opacity);
  const V inv_det = V(1) / f.det;
  // Slightly beyond alpha = kMinAlpha: blending applies the exact test, this bound must not miss
  // pixels.
  const V extent2 = fma(log2_opacity - V(kLog2MinAlpha), V(2 * kLn2), V(1e-3));
  const V extent_x = sqrt(extent2 * f.a);
  const V extent_y2 = extent2 * f.c;
  const V extent_y = sqrt(extent_y2);
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
  out[12] = extent_y2;
  out[13] = extent_x;
  out[14] = extent_x * f.b / f.a;
  out[15] = sqrt(extent2 * (middle + sqrt(fma(spread, spread, f.b * f.b))));
  // Every comparison is false for NaN.
  const V huge(1e30);
  return (f.p[2] >= camera.near_m) & (opacity >= V(kMinAlpha)) & (f.det > V(0)) & (out[15] < huge) &
         (inv_det < huge) & (f.u + extent_x > V(0)) & (f.u - extent_x < width) &
         (f.v + extent_y > V(0)) & (f.v - extent_y < height);
}

/// First and last pixel whose center lies in a range; empty when first > last.
struct PixelSpan {
  int first, last;
};
template <typename T>
APVI_HD inline PixelSpan pixel_span(T low, T high, int size) {
  const T half(0.5);
  const auto end = static_cast<T>(size);
  return {static_cast<int>(std::ceil(clamp_max(clamp_min(low - half, T(0)), end))),
          static_cast<int>(std::floor(clamp_max(clamp_min(high - half, T(-1)), end - T(1))))};
}

/// Image rows that the ellipse of a splat touches. T is a scalar from here on.
template <typename T>
APVI_HD inline PixelSpan row_span(const Splat<T>& s, int height) {
  const T extent_y = std::sqrt(s.extent_y2);
  return pixel_span(s.v - extent_y, s.v + extent_y, height);
}

/// Image columns that it touches between the centers of two rows.
template <typename T>
APVI_HD inline PixelSpan column_span(const Splat<T>& s, int top, int bottom, int width) {
  const T low = static_cast<T>(top) + T(0.5) - s.v;
  const T high = static_cast<T>(bottom) + T(0.5) - s.v;
  const T right = clamp_max(clamp_min(s.tip_dy, low), high);
  const T left = clamp_max(clamp_min(-s.tip_dy, low), high);
  const T half_right = s.half * std::sqrt(clamp_min(s.extent_y2 - right * right, T(0)));
  const T half_left = s.half * std::sqrt(clamp_min(s.extent_y2 - left * left, T(0)));
  return pixel_span(s.u + s.slope * left - half_left, s.u + s.slope * right + half_right, width);
}

/// Tile columns that it touches in a row of tiles; `rows` as returned by `row_span`.
template <typename T>
APVI_HD inline PixelSpan tile_column_span(const Splat<T>& s, PixelSpan rows, int tile_row,
                                          int width) {
  const int top = clamp_min(rows.first, tile_row * kTileSize);
  const int bottom = clamp_max(rows.last, tile_row * kTileSize + kTileSize - 1);
  const PixelSpan columns = column_span(s, top, bottom, width);
  if (columns.first > columns.last) return {0, -1};
  return {columns.first / kTileSize, columns.last / kTileSize};
}

/// Derivative with respect to the footprint, from the sums over its pixels (see kSlotSize).
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
  if (antialiased) {  // ln(opacity) + ln(det_orig / det) / 2
    const V half = V(0.5) * sums[4];
    const V orig = half / f.det_orig;
    const V blurred = half * inv_det;
    g.a = g.a + orig * (f.c - camera.low_pass) - blurred * f.c;
    g.b = g.b - V(2) * f.b * (orig - blurred);
    g.c = g.c + orig * (f.a - camera.low_pass) - blurred * f.a;
  }
  return g;
}

/// Unit vector from the camera to the Gaussian, in the world; returns the inverse distance.
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

}  // namespace apvi::gaussians
