// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "gaussian_rows.cuh"

/// What all walks over the splats of a tile share. A warp has a block of 8x8 pixels, two to a
/// thread, and looks only at splats whose ellipse touches it. A tile's list is cut in chunks that
/// are drawn side by side, see blend.cu.
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

/// A splat of a tile that waits in shared memory.
struct alignas(16) Waiting {
  float4 a, b;
  float2 c;
  std::uint32_t slot;
  unsigned blocks;  ///< which of the tile's four it touches
};

template <int kCount>
struct Batch {
  Waiting splats[kCount];

  __device__ void put(int at, const Splat<float>& s, std::uint32_t slot, unsigned blocks) {
    Waiting& to = splats[at];
    to.a = make_float4(s.u, s.v, s.e_0, s.e_xx);
    to.b = make_float4(s.e_xy, s.e_yy, s.color[0], s.color[1]);
    to.c = make_float2(s.color[2], s.z);
    to.slot = slot;
    to.blocks = blocks;
  }
  __device__ void put_none(int at) { splats[at].blocks = 0; }
  __device__ Drawable get(int at) const {
    const float4 x = splats[at].a;
    const float4 y = splats[at].b;
    const float2 z = splats[at].c;
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
  std::uint32_t id;           ///< counts those of all tiles, in their order
  std::uint32_t first, last;  ///< of the tile
  std::uint32_t begin, end;   ///< in the list of all slots

  __device__ Chunk(const Frame& frame, const BinPointers& bins, std::uint32_t slot_capacity,
                   std::uint32_t turn) {
    none = turn >= bins.chunk_begin[frame.tiles()];
    if (none) return;
    id = bins.turns[turn];
    tile = static_cast<int>(bins.chunk_tile[id]);
    first = bins.chunk_begin[tile];
    last = bins.chunk_begin[tile + 1] - 1;
    begin = bins.tile_begin[tile] + (id - first) * bins.chunk_slots;
    end = min(min(bins.tile_begin[tile + 1], begin + bins.chunk_slots), slot_capacity);
  }
  __device__ int size() const { return static_cast<int>(end - begin); }
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

/// What it does, and what it leaves of the light. That of a finished pixel is negative.
struct Share {
  float alpha, weight;
  bool drawn;
  bool finished;  ///< by this one
};
__device__ inline Share pass(const Reach& reach, int p, float& light) {
  Share out;
  out.alpha = reach.touched[p] ? fminf(reach.uncut[p], static_cast<float>(kMaxAlpha)) : 0.0f;
  const float weight = light * out.alpha;
  const float next = __fmaf_rn(-light, out.alpha, light);
  const bool over = next <= static_cast<float>(kMinTransmittance);
  out.drawn = reach.touched[p] && !over;
  out.finished = over && light > 0.0f;
  out.weight = over ? 0.0f : weight;
  light = over ? -fabsf(light) : next;
  return out;
}

/// Those of 32 splats that touch the warp's block, as bits.
template <int kCount>
__device__ inline unsigned touching(const Batch<kCount>& batch, int base) {
  const int warp = static_cast<int>(threadIdx.x) / kWarp;
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  return __ballot_sync(kAllLanes, (batch.splats[base + lane].blocks >> warp & 1U) != 0);
}

/// Calls f(number of a splat, what it is, its reach) for those of a batch's splats from `base` on
/// that touch the warp's block. The next one's reach is found while the last one's use waits.
inline constexpr unsigned kHighest = 1U << 31U;
template <int kCount, typename F>
__device__ inline void for_each_touching(const Batch<kCount>& batch, int base, const Place& place,
                                         F&& f) {
  // Counting the zeros above takes half of the instructions that finding the lowest bit does.
  unsigned left = __brev(touching(batch, base));
  while (left != 0) {
    const int first_zeros = __clz(static_cast<int>(left));
    left ^= kHighest >> first_zeros;
    const bool two = left != 0;
    const int second_zeros = two ? __clz(static_cast<int>(left)) : first_zeros;
    left &= ~(kHighest >> second_zeros);
    const int first = base + first_zeros;
    const int second = base + second_zeros;
    const Drawable a = batch.get(first);
    const Drawable b = batch.get(second);
    const Reach reach_a = reach_of(a, place);
    const Reach reach_b = reach_of(b, place);
    f(first, a, reach_a);
    if (two) f(second, b, reach_b);
  }
}

__device__ inline bool any_live(const float (&light)[kPixels]) {
  return light[0] > 0.0f || light[1] > 0.0f;
}

}  // namespace apvi::splat::cuda
