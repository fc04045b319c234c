// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "gaussian_rows.cuh"

/// What all walks over the splats of a tile share. A warp has a block of 8x8 pixels, two to a
/// thread, and looks only at splats whose ellipse touches it. A tile's list is cut in chunks that
/// are drawn side by side: first each says how much light it lets through, the product over those
/// before it is the light that it starts with.
namespace apvi::splat::cuda {

inline constexpr int kThreads = kTileWarps * kWarp;
inline constexpr int kBlock = 8;  // [px]
inline constexpr int kPixels = 2;
/// Instead of a weight: no pixel has the splat, but some were finished before it, which the walk
/// back must know. Less than any weight when compared as integers.
inline constexpr int kFinishedOnly = 1;

/// What the blending needs of a splat.
struct Drawable {
  float u, v, e_0, e_xx;
  float e_xy, e_yy, red, green;
  float blue, z;
};

/// Splats of a tile that wait in shared memory, and which of the tile's four blocks each touches.
template <int kCount>
struct Batch {
  float4 a[kCount];
  float4 b[kCount];
  float2 c[kCount];
  std::uint32_t slot[kCount];
  unsigned blocks[kCount];

  __device__ void put(int at, const Splat<float>& s) {
    a[at] = make_float4(s.u, s.v, s.e_0, s.e_xx);
    b[at] = make_float4(s.e_xy, s.e_yy, s.color[0], s.color[1]);
    c[at] = make_float2(s.color[2], s.z);
  }
  __device__ Drawable get(int at) const {
    const float4 x = a[at];
    const float4 y = b[at];
    const float2 z = c[at];
    return {x.x, x.y, x.z, x.w, y.x, y.y, y.z, y.w, z.x, z.y};
  }
};

struct Corner {
  int x, y;
};

/// The part of a tile's list that a block of threads draws.
struct Chunk {
  bool none;  ///< there are fewer chunks than blocks
  int tile;
  std::uint32_t id, first;  ///< this chunk and the first of the tile
  bool last;                ///< of the tile
  std::uint32_t begin, end;

  __device__ Chunk(const Frame& frame, const BinPointers& bins, std::uint32_t slot_capacity) {
    id = blockIdx.x;
    none = id >= bins.chunk_begin[frame.tiles()];
    if (none) return;
    tile = static_cast<int>(bins.chunk_tile[id]);
    first = bins.chunk_begin[tile];
    last = id + 1 == bins.chunk_begin[tile + 1];
    begin = bins.tile_begin[tile] + (id - first) * bins.chunk_slots;
    end = min(min(bins.tile_begin[tile + 1], begin + bins.chunk_slots), slot_capacity);
  }
  __device__ Corner corner(const Frame& frame) const {
    return {tile % frame.tiles_x() * kTileSize, tile / frame.tiles_x() * kTileSize};
  }
};

/// Bits of the blocks of the tile that the ellipse touches: left and right, then those below.
__device__ inline unsigned find_blocks(const Splat<float>& s, Corner tile, const Frame& frame) {
  const PixelSpan rows = rows_of(s, frame.height);
  unsigned out = 0;
  for (int half = 0; half < 2; ++half) {
    const int top = max(rows.first, tile.y + kBlock * half);
    const int bottom = min(rows.last, tile.y + kBlock * half + kBlock - 1);
    if (top > bottom) continue;
    const PixelSpan columns = columns_of(s, top, bottom, frame.width);
    if (columns.first > columns.last) continue;
    if (columns.first < tile.x + kBlock && columns.last >= tile.x) out |= 1U << (2 * half);
    if (columns.first < tile.x + 2 * kBlock && columns.last >= tile.x + kBlock) {
      out |= 2U << (2 * half);
    }
  }
  return out;
}

/// The pixels of a thread: one, and one half a block below.
struct Place {
  int x, y;
  float fx, fy;

  __device__ explicit Place(Corner tile) {
    const int warp = static_cast<int>(threadIdx.x) / kWarp;
    const int lane = static_cast<int>(threadIdx.x) % kWarp;
    x = tile.x + warp % 2 * kBlock + lane % kBlock;
    y = tile.y + warp / 2 * kBlock + lane / kBlock;
    fx = static_cast<float>(x) + 0.5f;
    fy = static_cast<float>(y) + 0.5f;
  }
  __device__ int row(int pixel) const { return y + pixel * (kBlock / kPixels); }
  __device__ bool inside(const Frame& frame, int pixel) const {
    return x < frame.width && row(pixel) < frame.height;
  }
  __device__ std::int64_t index(const Frame& frame, int pixel) const {
    return static_cast<std::int64_t>(row(pixel)) * frame.width + x;
  }
};

__device__ inline float exp2_fast(float x) {
  float y;
  asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
}

/// What a splat would do at the two pixels of a thread, whatever lies before it. Products and sums
/// are named, so that all walks find the same bits.
struct Reach {
  float dx;
  float dy[kPixels];
  float uncut[kPixels];
  bool touched[kPixels];
};
__device__ inline Reach reach_of(const Drawable& s, const Place& place) {
  Reach out;
  out.dx = place.fx - s.u;
  const float flat = __fmaf_rn(s.e_xx, __fmul_rn(out.dx, out.dx), s.e_0);
  const float shear = __fmul_rn(s.e_xy, out.dx);
#pragma unroll
  for (int p = 0; p < kPixels; ++p) {
    out.dy[p] = place.fy + static_cast<float>(p * (kBlock / kPixels)) - s.v;
    const float e = __fmaf_rn(out.dy[p], __fmaf_rn(out.dy[p], s.e_yy, shear), flat);
    out.uncut[p] = exp2_fast(e);
    out.touched[p] = e >= static_cast<float>(kLog2MinAlpha);
  }
  return out;
}

/// What it does, and what it leaves of the light.
struct Share {
  float alpha, weight;
  bool seen, drawn;  ///< not drawn although seen: the pixel is finished
};
__device__ inline Share pass(const Reach& reach, int p, float& light) {
  Share out;
  out.alpha = fminf(reach.uncut[p], static_cast<float>(kMaxAlpha));
  out.seen = reach.touched[p] && light > 0.0f;
  const float next = __fmaf_rn(-light, out.alpha, light);
  out.drawn = out.seen && next > static_cast<float>(kMinTransmittance);
  out.weight = out.drawn ? __fmul_rn(light, out.alpha) : 0.0f;
  light = out.seen ? (out.drawn ? next : -light) : light;
  return out;
}

template <int kCount, bool kDrawnOnly>
__device__ inline void fill(Batch<kCount>& batch, const Frame& frame, Corner tile,
                            const SplatPointers& splats, const BinPointers& bins,
                            std::uint32_t begin, std::uint32_t end, const float* slot_weight) {
  const auto at = static_cast<int>(threadIdx.x);
  if (at >= kCount) return;
  batch.blocks[at] = 0;
  if (begin + at >= end) return;
  const std::uint32_t slot = bins.tile_slots[begin + at];
  batch.slot[at] = slot;
  if (kDrawnOnly && slot_weight[slot] == 0.0f) return;
  const Splat<float> s = splats.splats[bins.slot_splat[slot]];
  batch.put(at, s);
  batch.blocks[at] = find_blocks(s, tile, frame);
}

/// Those of 32 splats that touch the warp's block, as bits.
template <int kCount>
__device__ inline unsigned touching(const Batch<kCount>& batch, int base) {
  const int warp = static_cast<int>(threadIdx.x) / kWarp;
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  return __ballot_sync(kAllLanes, (batch.blocks[base + lane] >> warp & 1U) != 0);
}

/// Calls f(number of a splat, what it is, its reach) for those of a batch's splats from `base` on
/// that touch the warp's block. The next one's reach is found while the last one's use waits.
template <int kCount, typename F>
__device__ inline void for_each_touching(const Batch<kCount>& batch, int base, const Place& place,
                                         F&& f) {
  unsigned left = touching(batch, base);
  while (left != 0) {
    const int first = base + __ffs(static_cast<int>(left)) - 1;
    left &= left - 1;
    const bool two = left != 0;
    const int second = two ? base + __ffs(static_cast<int>(left)) - 1 : first;
    left &= left - 1;
    const Drawable a = batch.get(first);
    const Drawable b = batch.get(second);
    const Reach reach_a = reach_of(a, place);
    const Reach reach_b = reach_of(b, place);
    f(first, a, reach_a);
    if (two) f(second, b, reach_b);
  }
}

/// Light that a chunk starts with; negative: finished before, or no pixel of the image.
__device__ inline void light_before(const Chunk& chunk, const Place& place, const Frame& frame,
                                    const ChunkPointers& chunks, float (&light)[kPixels]) {
  for (int p = 0; p < kPixels; ++p) light[p] = place.inside(frame, p) ? 1.0f : -1.0f;
#pragma unroll 4
  for (std::uint32_t k = chunk.first; k < chunk.id; ++k) {
    const float2 through = chunks.through[k * kThreads + threadIdx.x];
    light[0] *= through.x;
    light[1] *= through.y;
  }
  for (float& x : light) {
    if (x <= static_cast<float>(kMinTransmittance)) x = -1.0f;
  }
}

__device__ inline bool any_live(const float (&light)[kPixels]) {
  return light[0] > 0.0f || light[1] > 0.0f;
}

}  // namespace apvi::splat::cuda
