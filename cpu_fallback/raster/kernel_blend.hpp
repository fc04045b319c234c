// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "cpu_fallback/raster/raster_kernels.hpp"

/// Front-to-back blending of the splats of one tile, a block of kWidth pixels at a time, and the
/// backward pass, which repeats the forward traversal. V is a vector of simd_*.
///
/// A tile is divided into strips of kStrip columns, and these into blocks of kWidth pixels. Strips
/// are contiguous in memory, so a block, given by its strip and first row, begins at (16 strip +
/// row) kStrip; the first factor is its bit in a mask.
namespace apvi::gaussians {

inline constexpr int kTilePixels = kTileSize * kTileSize;
inline constexpr int kStrip = 4;
inline constexpr int kStrips = kTileSize / kStrip;
/// Splats whose blocks are found together before blending: the number of blocks is hard to predict,
/// and this limits the cost of mispredicted branches.
inline constexpr std::uint32_t kGroup = 16;

using BlockMask = std::uint64_t;

/// Offsets of rows from the first row of a tile.
template <typename S>
inline constexpr S kRowOffset[kTileSize] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};

constexpr int tile_index(int x, int y) {
  return (x / kStrip * kTileSize + y) * kStrip + x % kStrip;
}

/// Bits of rows that begin a block.
template <typename V>
constexpr BlockMask block_rows() {
  BlockMask out = 0;
  for (int bit = 0; bit < kTileSize * kStrips; bit += V::kWidth / kStrip) {
    out |= BlockMask{1} << static_cast<unsigned>(bit);
  }
  return out;
}

/// Bits of the blocks in which the splat's ellipse contains a pixel.
template <typename V>
[[gnu::always_inline]] inline BlockMask find_blocks(const Splat<typename V::Scalar>& s, int x0,
                                                    int y0) {
  using S = typename V::Scalar;
  const S u = s.u - S(x0) - S(0.5);  // relative to the center of the tile's first pixel
  const S v = s.v - S(y0) - S(0.5);
  BlockMask rows = 0;
  for (int group = 0; group < kTileSize; group += V::kWidth) {
    const V dy = V::ramp() + V(S(group) - v);
    const V half = V(s.half) * sqrt(V(s.extent_y2) - dy * dy);  // NaN outside the ellipse
    const V middle = fma(V(s.slope), dy, V(u));
    const V first = V(0) - floor(half - middle);
    const V last = floor(middle + half);
    const auto covered = first <= last;
    for (int strip = 0; strip < kStrips; ++strip) {
      const auto in_strip =
          covered & (last >= V(strip * kStrip)) & (first <= V(strip * kStrip + kStrip - 1));
      rows |= BlockMask{bits(in_strip)} << static_cast<unsigned>(strip * kTileSize + group);
    }
  }
  for (int height = 1; height < V::kWidth / kStrip; height *= 2) {
    rows |= rows >> static_cast<unsigned>(height);
  }
  return rows & block_rows<V>();
}

/// Terms of a splat's exponent that are constant over the rows of a tile.
template <typename V>
struct Slopes {
  using S = typename V::Scalar;
  V dx[kStrips];
  V flat[kStrips];
  V shear[kStrips];
  V e_yy, dy;

  [[gnu::always_inline]] Slopes(const Splat<S>& s, int x0, int y0)
      : e_yy(s.e_yy), dy(V::ramp_down(kStrip) + V(S(y0) + S(0.5) - s.v)) {
    const V first = V::ramp_across(kStrip) + V(S(x0) + S(0.5) - s.u);
    for (int strip = 0; strip < kStrips; ++strip) {
      dx[strip] = first + V(S(strip * kStrip));
      flat[strip] = fma(V(s.e_xx), dx[strip] * dx[strip], V(s.e_0));
      shear[strip] = V(s.e_xy) * dx[strip];
    }
  }

  /// log2(alpha)
  V exponent(int strip, V height) const {
    return fma(height, fma(height, e_yy, shear[strip]), flat[strip]);
  }
};

/// Transmittance of each pixel of a tile; negative once a pixel is finished.
template <typename V>
struct Transmittance {
  using S = typename V::Scalar;
  alignas(64) S values[kTilePixels];
  BlockMask live;  // blocks with unfinished pixels

  Transmittance(int width, int height)
      : live(block_rows<V>()) {  // pixels outside the image are finished
    for (int y = 0; y < kTileSize; ++y) {
      for (int x = 0; x < kTileSize; ++x) {
        values[tile_index(x, y)] = x < width && y < height ? S(1) : S(-1);
      }
    }
    drop_finished();
  }

  void drop_finished() {
    for (BlockMask remaining = live; remaining != 0; remaining &= remaining - 1) {
      const int bit = __builtin_ctzll(remaining);
      if (!any(V::load(values + bit * kStrip) > V(0))) live &= ~(BlockMask{1} << unsigned(bit));
    }
  }

  /// Contribution of a splat to the pixels of a block.
  struct BlendStep {
    V weight;
    typename V::Mask contributes;
  };

  /// Blends one splat into the block at `at` with its `alpha` there; `visible`: where alpha reaches
  /// kMinAlpha.
  [[gnu::always_inline]] BlendStep blend(int at, V alpha, typename V::Mask visible) {
    const V before = V::load(values + at);
    const V next = fma(V(0) - before, alpha, before);
    const auto contributes = visible & (next > V(kMinTransmittance));
    select(visible, select(contributes, next, negative_abs(before)), before).store(values + at);
    return {select_or_zero(contributes, before * alpha), contributes};
  }

  S remaining(int pixel) const {
    return values[pixel] > S(0) ? values[pixel] : S(0) - values[pixel];
  }
};

template <typename S>
struct TileImage {
  alignas(64) S color[3][kTilePixels];
  alignas(64) S depth[kTilePixels];
};

/// The image region of a tile.
struct TileFrame {
  int x0, y0, width, height;
};
template <typename V>
TileFrame tile_frame(const BlendArgs<typename V::Scalar>& a, int tile) {
  const int x0 = tile % a.tiles_x * kTileSize;
  const int y0 = tile / a.tiles_x * kTileSize;
  return {x0, y0, a.width - x0 < kTileSize ? a.width - x0 : kTileSize,
          a.height - y0 < kTileSize ? a.height - y0 : kTileSize};
}

/// Consecutive splats of a tile, with the blocks that each touches.
template <typename V>
struct Group {
  std::uint32_t count;
  BlockMask blocks[kGroup] = {};

  /// With `contributing_only`, splats without a contribution in the forward pass have no blocks.
  [[gnu::always_inline]] Group(const BlendArgs<typename V::Scalar>& a, const TileFrame& frame,
                               std::uint32_t begin, std::uint32_t end, bool contributing_only)
      : count(end - begin < kGroup ? end - begin : kGroup) {
    for (std::uint32_t k = begin + kGroup; k < end && k < begin + 2 * kGroup; ++k) {
      __builtin_prefetch(&a.splats[a.entries[k].splat]);
    }
    for (std::uint32_t k = 0; k < count; ++k) {
      const Entry entry = a.entries[begin + k];
      const bool wanted = !contributing_only || a.slot_weight[entry.slot] != 0;
      const BlockMask found = find_blocks<V>(a.splats[entry.splat], frame.x0, frame.y0);
      blocks[k] = wanted ? found : 0;
    }
  }
};

/// Blends one splat into a tile; returns its largest weight. Negative when it contributes nowhere,
/// but may have finished pixels, which the backward pass must repeat.
template <typename V>
[[gnu::always_inline]] inline typename V::Scalar blend_splat(const Splat<typename V::Scalar>& s,
                                                             BlockMask blocks,
                                                             const TileFrame& frame,
                                                             Transmittance<V>& transmittance,
                                                             TileImage<typename V::Scalar>& image) {
  using S = typename V::Scalar;
  const Slopes<V> slopes(s, frame.x0, frame.y0);
  const V shade[4] = {V(s.color[0]), V(s.color[1]), V(s.color[2]), V(s.z)};
  V best(0);
  for (BlockMask remaining = blocks; remaining != 0; remaining &= remaining - 1) {
    const int bit = __builtin_ctzll(remaining);
    const int at = bit * kStrip;
    const V e = slopes.exponent(bit / kTileSize, slopes.dy + V(kRowOffset<S>[bit % kTileSize]));
    const V alpha = clamp_max(exp2(e), V(kMaxAlpha));
    const V weight = transmittance.blend(at, alpha, e >= V(kLog2MinAlpha)).weight;
    best = clamp_min(best, weight);
    for (int c = 0; c < 3; ++c) {
      fma(weight, shade[c], V::load(image.color[c] + at)).store(image.color[c] + at);
    }
    fma(weight, shade[3], V::load(image.depth + at)).store(image.depth + at);
  }
  const S weight = reduce_max(best);
  return weight > S(0) || blocks == 0 ? weight : S(-1);
}

template <typename V>
void blend_tile(const BlendArgs<typename V::Scalar>& a, int tile) {
  using S = typename V::Scalar;
  const TileFrame frame = tile_frame<V>(a, tile);
  Transmittance<V> transmittance(frame.width, frame.height);
  TileImage<S> image = {};
  std::uint32_t k = a.tile_begin[tile];
  const std::uint32_t end = a.tile_begin[tile + 1];
  while (k < end && transmittance.live != 0) {
    const Group<V> group(a, frame, k, end, false);
    for (std::uint32_t i = 0; i < group.count; ++i, ++k) {
      const Entry entry = a.entries[k];
      const BlockMask blocks = group.blocks[i] & transmittance.live;
      a.slot_weight[entry.slot] =
          blend_splat(a.splats[entry.splat], blocks, frame, transmittance, image);
    }
    transmittance.drop_finished();
  }
  for (; k < end; ++k) a.slot_weight[a.entries[k].slot] = S(0);
  for (int y = 0; y < frame.height; ++y) {
    for (int x = 0; x < frame.width; ++x) {
      const int at = tile_index(x, y);
      const std::int64_t to = std::int64_t(frame.y0 + y) * a.width + frame.x0 + x;
      const S background_weight = transmittance.remaining(at);
      const S alpha = S(1) - background_weight;
      for (int c = 0; c < 3; ++c) {
        a.color[3 * to + c] = image.color[c][at] + background_weight * a.background[c];
      }
      a.alpha[to] = alpha;
      a.depth[to] = alpha > S(0) ? image.depth[at] / alpha : S(0);
    }
  }
}

/// Per-pixel state of the backward pass: derivatives of the loss by color, by the sum of weighted
/// depths, by alpha; and the weighted sum of the remaining splats.
template <typename V>
struct TileGradient {
  using S = typename V::Scalar;
  alignas(64) S color[3][kTilePixels];
  alignas(64) S depth[kTilePixels];
  alignas(64) S alpha[kTilePixels];
  alignas(64) S rest[kTilePixels];

  TileGradient(const BlendBackwardArgs<S>& a, const TileFrame& frame) : TileGradient() {
    for (int y = 0; y < frame.height; ++y) {
      const std::int64_t first = std::int64_t(frame.y0 + y) * a.forward.width + frame.x0;
      for (int x = 0; x < frame.width; x += kStrip) {
        const int count = frame.width - x < kStrip ? frame.width - x : kStrip;
        if (count == kStrip) {
          load(a, first + x, tile_index(x, y), kStrip);  // a compile-time constant count
        } else {
          load(a, first + x, tile_index(x, y), count);
        }
      }
    }
  }

 private:
  TileGradient() : color{}, depth{}, alpha{}, rest{} {}

  /// Adjacent pixels: from image index `from` to tile index `to`.
  [[gnu::always_inline]] void load(const BlendBackwardArgs<S>& a, std::int64_t from, int to,
                                   int count) {
    const BlendArgs<S>& f = a.forward;
    for (int i = 0; a.grad_alpha != nullptr && i < count; ++i) {
      alpha[to + i] = a.grad_alpha[from + i];
      rest[to + i] = alpha[to + i] * f.alpha[from + i];
    }
    for (int i = 0; a.grad_depth != nullptr && i < count; ++i) {
      const S opacity = f.alpha[from + i];
      depth[to + i] = opacity > S(0) ? a.grad_depth[from + i] / opacity : S(0);
      alpha[to + i] -= depth[to + i] * f.depth[from + i];
    }
    for (int i = 0; i < count; ++i) {
      for (int c = 0; c < 3; ++c) {
        const S g = a.grad_color[3 * (from + i) + c];
        color[c][to + i] = g;
        rest[to + i] += g * f.color[3 * (from + i) + c];
      }
    }
  }
};

/// Backward pass of `blend_splat`: repeats its traversal and fills a slot.
template <typename V>
[[gnu::always_inline]] inline void blend_splat_backward(const Splat<typename V::Scalar>& s,
                                                        BlockMask blocks, const TileFrame& frame,
                                                        Transmittance<V>& transmittance,
                                                        TileGradient<V>& grad,
                                                        typename V::Scalar* slot) {
  using S = typename V::Scalar;
  const Slopes<V> slopes(s, frame.x0, frame.y0);
  const V shade[4] = {V(s.color[0]), V(s.color[1]), V(s.color[2]), V(s.z)};
  V sum[kSlotSize];
  for (V& x : sum) x = V(0);
  for (BlockMask remaining = blocks; remaining != 0; remaining &= remaining - 1) {
    const int bit = __builtin_ctzll(remaining);
    const int at = bit * kStrip;
    const V dx = slopes.dx[bit / kTileSize];
    const V dy = slopes.dy + V(kRowOffset<S>[bit % kTileSize]);
    const V e = slopes.exponent(bit / kTileSize, dy);
    const V raw_alpha = exp2(e);
    const V alpha = clamp_max(raw_alpha, V(kMaxAlpha));
    const auto [weight, contributes] = transmittance.blend(at, alpha, e >= V(kLog2MinAlpha));
    V value = V::load(grad.alpha + at);
    for (int c = 0; c < 4; ++c) {
      const V g = V::load((c < 3 ? grad.color[c] : grad.depth) + at);
      value = fma(g, shade[c], value);
      sum[c] = fma(weight, g, sum[c]);
    }
    const V rest = fma(V(0) - weight, value, V::load(grad.rest + at));
    rest.store(grad.rest + at);
    // By ln(alpha): weight (value - what lies behind); zero where alpha is clamped.
    const V behind = rest * alpha * reciprocal(V(1) - alpha);
    const V v = select_or_zero(contributes & (raw_alpha <= V(kMaxAlpha)),
                               fma(weight, value, V(0) - behind));
    const V v_dx = v * dx;
    const V v_dy = v * dy;
    sum[4] = sum[4] + v;
    sum[5] = sum[5] + v_dx;
    sum[6] = fma(v_dx, dx, sum[6]);
    sum[7] = sum[7] + v_dy;
    sum[8] = fma(v_dy, dy, sum[8]);
    sum[9] = fma(v_dx, dy, sum[9]);
  }
  V::sums(sum, slot);
}

template <typename V>
void blend_tile_backward(const BlendBackwardArgs<typename V::Scalar>& a, int tile,
                         double* background) {
  using S = typename V::Scalar;
  const BlendArgs<S>& f = a.forward;
  const TileFrame frame = tile_frame<V>(f, tile);
  Transmittance<V> transmittance(frame.width, frame.height);
  TileGradient<V> grad(a, frame);
  for (int y = 0; y < frame.height; ++y) {
    for (int x = 0; x < frame.width; ++x) {
      const double background_weight =
          1.0 - double(f.alpha[std::int64_t(frame.y0 + y) * f.width + frame.x0 + x]);
      for (int c = 0; c < 3; ++c)
        background[c] += background_weight * double(grad.color[c][tile_index(x, y)]);
    }
  }
  const std::uint32_t end = f.tile_begin[tile + 1];
  for (std::uint32_t k = f.tile_begin[tile]; k < end && transmittance.live != 0;) {
    const Group<V> group(f, frame, k, end, true);
    for (std::uint32_t i = 0; i < group.count; ++i, ++k) {
      const Entry entry = f.entries[k];
      if (group.blocks[i] == 0) continue;
      blend_splat_backward(f.splats[entry.splat], group.blocks[i] & transmittance.live, frame,
                           transmittance, grad,
                           a.slot_gradient + std::int64_t(entry.slot) * kSlotSize);
    }
    transmittance.drop_finished();
  }
}

}  // namespace apvi::gaussians
