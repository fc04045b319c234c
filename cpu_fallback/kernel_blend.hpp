// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "raster_kernels.hpp"

/// Blending of the splats of one tile front to back, a row of kWidth pixels at a time, and its
/// derivative by the same walk again. V is a vector of simd_*.
namespace apvi::splat {

inline constexpr int kTilePixels = kTileSize * kTileSize;

/// Blocks of kWidth pixels side by side in a tile.
template <typename V>
inline constexpr int kBlocks = kTileSize / V::kWidth;

/// Bit r of rows[j] says whether the splat's ellipse holds a pixel of row r in block j.
template <typename V>
void find_rows(const Splat<typename V::Scalar>& s, int x0, int y0, unsigned* rows) {
  using S = typename V::Scalar;
  constexpr int kW = V::kWidth;
  const S u = s.u - S(x0) - S(0.5);  // from the centre of the tile's first pixel
  const S v = s.v - S(y0) - S(0.5);
  for (int j = 0; j < kBlocks<V>; ++j) rows[j] = 0;
  for (int group = 0; group < kBlocks<V>; ++group) {
    const V dy = V::ramp() + V(S(group * kW) - v);
    const V half = V(s.half) * sqrt(V(s.reach_y2) - dy * dy);  // NaN where the ellipse is not
    const V middle = fma(V(s.slope), dy, V(u));
    const V first = V(0) - floor(half - middle);
    const V last = floor(middle + half);
    const auto some = first <= last;
    for (int j = 0; j < kBlocks<V>; ++j) {
      const auto hit = some & (last >= V(j * kW)) & (first <= V(j * kW + kW - 1));
      rows[j] |= bits(hit) << static_cast<unsigned>(group * kW);
    }
  }
}

/// A splat's opacity along one block of a tile: everything that does not change from row to row.
template <typename V>
struct Column {
  V dx, flat, shear, e_yy;

  Column(const Splat<typename V::Scalar>& s, int x)
      : dx(V::ramp() + V(x + 0.5 - s.u)),
        flat(fma(V(s.e_xx), dx * dx, V(s.e_0))),
        shear(V(s.e_xy) * dx),
        e_yy(s.e_yy) {}

  /// log2(alpha)
  V exponent(V dy) const { return fma(dy, fma(dy, e_yy, shear), flat); }
};

/// How much light still comes through at each pixel of a tile, and which rows have any.
template <typename V>
struct Transmittance {
  using S = typename V::Scalar;
  alignas(64) S now[kTilePixels];    // 0 once the pixel is finished
  alignas(64) S final[kTilePixels];  // what it was then
  unsigned live[kBlocks<V>];         // bit r: row r of the block has unfinished pixels

  Transmittance(int width, int height) {  // of what lies inside the image
    for (int y = 0; y < kTileSize; ++y) {
      for (int x = 0; x < kTileSize; ++x) {
        now[y * kTileSize + x] = x < width && y < height ? S(1) : S(0);
        final[y * kTileSize + x] = S(1);
      }
    }
    const unsigned rows = (1U << static_cast<unsigned>(height)) - 1U;
    for (int j = 0; j < kBlocks<V>; ++j) live[j] = j * V::kWidth < width ? rows : 0U;
  }

  bool finished() const {
    unsigned any_row = 0;
    for (const unsigned rows : live) any_row |= rows;
    return any_row == 0;
  }

  /// One splat more at the pixels from `at`, of `alpha` there; returns its weight. `seen`: pixels
  /// where it is not too faint.
  V pass(int at, int block, int row, V alpha, typename V::Mask seen, V& before) {
    before = V::load(now + at);
    const V next = fma(V(0) - before, alpha, before);
    const auto drawn = seen & (next > V(kMinTransmittance));
    const V after = select(seen, keep(drawn, next), before);
    after.store(now + at);
    const auto stopped = and_not(seen, drawn) & (before > V(0));
    if (any(stopped)) {
      select(stopped, before, V::load(final + at)).store(final + at);
      if (!any(after > V(0))) live[block] &= ~(1U << static_cast<unsigned>(row));
    }
    return keep(drawn, before * alpha);
  }

  S left(int pixel) const { return now[pixel] > S(0) ? now[pixel] : final[pixel]; }
};

template <typename S>
struct TileImage {
  alignas(64) S color[3][kTilePixels];
  alignas(64) S depth[kTilePixels];
};

/// The part of an image that a tile covers.
struct TileFrame {
  int x0, y0, width, height;
};
template <typename V>
TileFrame frame_of(const BlendArgs<typename V::Scalar>& a, int tile) {
  const int x0 = tile % a.tiles_x * kTileSize;
  const int y0 = tile / a.tiles_x * kTileSize;
  return {x0, y0, a.width - x0 < kTileSize ? a.width - x0 : kTileSize,
          a.height - y0 < kTileSize ? a.height - y0 : kTileSize};
}

/// Draws one splat into a tile; returns its largest weight.
template <typename V>
typename V::Scalar draw(const Splat<typename V::Scalar>& s, const TileFrame& frame,
                        Transmittance<V>& light, TileImage<typename V::Scalar>& image) {
  unsigned rows[kBlocks<V>];
  find_rows<V>(s, frame.x0, frame.y0, rows);
  const V shade[4] = {V(s.color[0]), V(s.color[1]), V(s.color[2]), V(s.z)};
  V best(0);
  for (int j = 0; j < kBlocks<V>; ++j) {
    const Column<V> column(s, frame.x0 + j * V::kWidth);
    for (unsigned left = rows[j] & light.live[j]; left != 0; left &= left - 1) {
      const int row = __builtin_ctz(left);
      const int at = row * kTileSize + j * V::kWidth;
      const V e = column.exponent(V(frame.y0 + row + 0.5 - s.v));
      const V alpha = at_most(exp2(e), V(kMaxAlpha));
      V before;
      const V weight = light.pass(at, j, row, alpha, e >= V(kLog2MinAlpha), before);
      best = at_least(best, weight);
      for (int c = 0; c < 3; ++c) {
        fma(weight, shade[c], V::load(image.color[c] + at)).store(image.color[c] + at);
      }
      fma(weight, shade[3], V::load(image.depth + at)).store(image.depth + at);
    }
  }
  return largest(best);
}

template <typename V>
void blend_tile(const BlendArgs<typename V::Scalar>& a, int tile) {
  using S = typename V::Scalar;
  const TileFrame frame = frame_of<V>(a, tile);
  Transmittance<V> light(frame.width, frame.height);
  TileImage<S> image = {};
  std::uint32_t k = a.tile_begin[tile];
  const std::uint32_t end = a.tile_begin[tile + 1];
  for (; k < end && !light.finished(); ++k) {
    a.slot_weight[a.entries[k].slot] = draw(a.splats[a.entries[k].splat], frame, light, image);
  }
  for (; k < end; ++k) a.slot_weight[a.entries[k].slot] = S(0);
  for (int y = 0; y < frame.height; ++y) {
    for (int x = 0; x < frame.width; ++x) {
      const int at = y * kTileSize + x;
      const std::int64_t to = std::int64_t(frame.y0 + y) * a.width + frame.x0 + x;
      const S through = light.left(at);
      const S alpha = S(1) - through;
      for (int c = 0; c < 3; ++c) {
        a.color[3 * to + c] = image.color[c][at] + through * a.background[c];
      }
      a.alpha[to] = alpha;
      a.depth[to] = alpha > S(0) ? image.depth[at] / alpha : S(0);
    }
  }
}

/// What the walk back needs of each pixel: derivatives of the loss by colour, by the sum of
/// weighted depths, by alpha; and the part of the weighted sum of all that is still to come.
template <typename V>
struct TileGradient {
  using S = typename V::Scalar;
  alignas(64) S color[3][kTilePixels];
  alignas(64) S depth[kTilePixels];
  alignas(64) S alpha[kTilePixels];
  alignas(64) S rest[kTilePixels];

  TileGradient(const BlendBackwardArgs<S>& a, const TileFrame& frame) {
    const BlendArgs<S>& f = a.forward;
    for (int at = 0; at < kTilePixels; ++at) {
      const int x = at % kTileSize;
      const int y = at / kTileSize;
      const bool inside = x < frame.width && y < frame.height;
      const std::int64_t from = inside ? std::int64_t(frame.y0 + y) * f.width + frame.x0 + x : 0;
      const bool hit = inside && f.alpha[from] > S(0);
      const S by_sum = hit ? a.grad_depth[from] / f.alpha[from] : S(0);
      S total = inside ? a.grad_alpha[from] * f.alpha[from] : S(0);
      for (int c = 0; c < 3; ++c) {
        const S g = inside ? a.grad_color[3 * from + c] : S(0);
        color[c][at] = g;
        total += g * f.color[3 * from + c];
      }
      depth[at] = by_sum;
      alpha[at] = inside ? a.grad_alpha[from] - by_sum * f.depth[from] : S(0);
      rest[at] = total;
    }
  }
};

/// The walk of `draw` again; fills a slot.
template <typename V>
void draw_backward(const Splat<typename V::Scalar>& s, const TileFrame& frame,
                   Transmittance<V>& light, TileGradient<V>& grad, typename V::Scalar* slot) {
  unsigned rows[kBlocks<V>];
  find_rows<V>(s, frame.x0, frame.y0, rows);
  const V shade[4] = {V(s.color[0]), V(s.color[1]), V(s.color[2]), V(s.z)};
  V sum[kSlotSize];
  for (V& x : sum) x = V(0);
  for (int j = 0; j < kBlocks<V>; ++j) {
    const Column<V> column(s, frame.x0 + j * V::kWidth);
    for (unsigned left = rows[j] & light.live[j]; left != 0; left &= left - 1) {
      const int row = __builtin_ctz(left);
      const int at = row * kTileSize + j * V::kWidth;
      const V dy(frame.y0 + row + 0.5 - s.v);
      const V e = column.exponent(dy);
      const V uncut = exp2(e);
      const V alpha = at_most(uncut, V(kMaxAlpha));
      V before;
      const V weight = light.pass(at, j, row, alpha, e >= V(kLog2MinAlpha), before);
      V value = V::load(grad.alpha + at);
      for (int c = 0; c < 4; ++c) {
        const V g = V::load((c < 3 ? grad.color[c] : grad.depth) + at);
        value = fma(g, shade[c], value);
        sum[c] = fma(weight, g, sum[c]);
      }
      const V rest = V::load(grad.rest + at) - weight * value;
      rest.store(grad.rest + at);
      // By ln(alpha), which is weight (value - what lies behind); nothing where alpha is cut.
      const V behind = rest * alpha * reciprocal(V(1) - alpha);
      const V v =
          keep((weight > V(0)) & (uncut <= V(kMaxAlpha)), fma(weight, value, V(0) - behind));
      const V v_dx = v * column.dx;
      const V v_dy = v * dy;
      sum[4] = sum[4] + v;
      sum[5] = sum[5] + v_dx;
      sum[6] = fma(v_dx, column.dx, sum[6]);
      sum[7] = sum[7] + v_dy;
      sum[8] = fma(v_dy, dy, sum[8]);
      sum[9] = fma(v_dx, dy, sum[9]);
    }
  }
  V::sums(sum, slot);
}

template <typename V>
void blend_tile_backward(const BlendBackwardArgs<typename V::Scalar>& a, int tile,
                         double* background) {
  using S = typename V::Scalar;
  const BlendArgs<S>& f = a.forward;
  const TileFrame frame = frame_of<V>(f, tile);
  Transmittance<V> light(frame.width, frame.height);
  TileGradient<V> grad(a, frame);
  for (int y = 0; y < frame.height; ++y) {
    for (int x = 0; x < frame.width; ++x) {
      const double through =
          1.0 - double(f.alpha[std::int64_t(frame.y0 + y) * f.width + frame.x0 + x]);
      for (int c = 0; c < 3; ++c)
        background[c] += through * double(grad.color[c][y * kTileSize + x]);
    }
  }
  const std::uint32_t end = f.tile_begin[tile + 1];
  for (std::uint32_t k = f.tile_begin[tile]; k < end && !light.finished(); ++k) {
    const Entry entry = f.entries[k];
    if (f.slot_weight[entry.slot] > S(0)) {
      draw_backward(f.splats[entry.splat], frame, light, grad,
                    a.slot_gradient + std::int64_t(entry.slot) * kSlotSize);
    }
  }
}

}  // namespace apvi::splat
