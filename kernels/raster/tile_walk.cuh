// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "kernels/raster/gaussian_loading.cuh"

/// Shared by all traversals of a tile's splats. A warp handles a block of 8x8 pixels, two per
/// thread, and only the splats whose ellipse touches it. A tile's list is split into chunks that
/// are blended concurrently, see blend.cu.
namespace apvi::gaussians::cuda {

inline constexpr int kThreads = kTileWarps * kWarp;
inline constexpr int kBlock = 8;  // [px]
inline constexpr int kPixels = 2;
/// In place of a weight: the splat contributes to no pixel but finished some, which the backward
/// pass must repeat. Smaller than any weight when compared as integers.
inline constexpr int kFinishedOnly = 1;

/// Splat parameters needed for blending.
struct SplatData {
  float u, v, e_0, e_xx;
  float e_xy, e_yy, red, green;
  float blue, z;
};

/// A splat of a tile staged in shared memory.
struct alignas(16) StagedSplat {
  float4 a, b;
  float2 c;
  std::uint32_t slot;
  unsigned blocks;  ///< mask of the tile's four blocks that it touches
};

template <int kCount>
struct Batch {
  StagedSplat splats[kCount];

  __device__ void store(int at, const Splat<float>& s, std::uint32_t slot, unsigned blocks) {
    StagedSplat& to = splats[at];
    to.a = make_float4(s.u, s.v, s.e_0, s.e_xx);
    to.b = make_float4(s.e_xy, s.e_yy, s.color[0], s.color[1]);
    to.c = make_float2(s.color[2], s.z);
    to.slot = slot;
    to.blocks = blocks;
  }
  __device__ void clear(int at) { splats[at].blocks = 0; }
  __device__ SplatData load(int at) const {
    const float4 x = splats[at].a;
    const float4 y = splats[at].b;
    const float2 z = splats[at].c;
    return {x.x, x.y, x.z, x.w, y.x, y.y, y.z, y.w, z.x, z.y};
  }
};

struct TileOrigin {
  int x, y;
};

/// The part of a tile's list that a thread block blends.
struct Chunk {
  bool is_empty;  ///< more thread blocks than chunks
  int tile;
  std::uint32_t id;           ///< index over all tiles, in their order
  std::uint32_t first, last;  ///< first and last chunk of the tile
  std::uint32_t begin, end;   ///< range in the list of all slots

  __device__ Chunk(const Frame& frame, const BinPointers& bins, std::uint32_t slot_capacity,
                   std::uint32_t ticket) {
    is_empty = ticket >= bins.chunk_begin[frame.tiles()];
    if (is_empty) return;
    id = bins.chunk_order[ticket];
    tile = static_cast<int>(bins.chunk_tile[id]);
    first = bins.chunk_begin[tile];
    last = bins.chunk_begin[tile + 1] - 1;
    begin = bins.tile_begin[tile] + (id - first) * bins.chunk_slots;
    end = min(min(bins.tile_begin[tile + 1], begin + bins.chunk_slots), slot_capacity);
  }
  __device__ int size() const { return static_cast<int>(end - begin); }
  __device__ TileOrigin origin(const Frame& frame) const {
    return {tile % frame.tiles_x() * kTileSize, tile / frame.tiles_x() * kTileSize};
  }
};

/// Mask of the tile's blocks that the ellipse touches: top left, top right, bottom left, bottom
/// right.
__device__ inline unsigned find_blocks(const Splat<float>& s, TileOrigin tile, const Frame& frame) {
  const PixelSpan rows = row_span(s, frame.height);
  unsigned out = 0;
  for (int half = 0; half < 2; ++half) {
    const int top = max(rows.first, tile.y + kBlock * half);
    const int bottom = min(rows.last, tile.y + kBlock * half + kBlock - 1);
    if (top > bottom) continue;
    const PixelSpan columns = column_span(s, top, bottom, frame.width);
    if (columns.first > columns.last) continue;
    if (columns.first < tile.x + kBlock && columns.last >= tile.x) out |= 1U << (2 * half);
    if (columns.first < tile.x + 2 * kBlock && columns.last >= tile.x + kBlock) {
      out |= 2U << (2 * half);
    }
  }
  return out;
}

/// The two pixels of a thread, half a block apart vertically.
struct PixelPair {
  int x, y;
  float fx, fy;

  __device__ explicit PixelPair(TileOrigin tile) {
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

/// Opacity of a splat at the two pixels of a thread, independent of other splats. Rounding is
/// explicit, so that all traversals get identical bits.
struct AlphaSample {
  float dx;
  float dy[kPixels];
  float raw_alpha[kPixels];
  bool touched[kPixels];
};
__device__ inline AlphaSample sample_alpha(const SplatData& s, const PixelPair& pixels) {
  AlphaSample out;
  out.dx = pixels.fx - s.u;
  const float flat = __fmaf_rn(s.e_xx, __fmul_rn(out.dx, out.dx), s.e_0);
  const float shear = __fmul_rn(s.e_xy, out.dx);
#pragma unroll
  for (int p = 0; p < kPixels; ++p) {
    out.dy[p] = pixels.fy + static_cast<float>(p * (kBlock / kPixels)) - s.v;
    const float e = __fmaf_rn(out.dy[p], __fmaf_rn(out.dy[p], s.e_yy, shear), flat);
    out.raw_alpha[p] = exp2_fast(e);
    out.touched[p] = e >= static_cast<float>(kLog2MinAlpha);
  }
  return out;
}

/// Contribution of a splat to a pixel and the remaining transmittance, negative for a finished
/// pixel.
struct BlendStep {
  float alpha, weight;
  bool contributes;
  bool finished;  ///< by this splat
};
__device__ inline BlendStep blend_pixel(const AlphaSample& sample, int p, float& transmittance) {
  BlendStep out;
  out.alpha = sample.touched[p] ? fminf(sample.raw_alpha[p], static_cast<float>(kMaxAlpha)) : 0.0f;
  const float weight = transmittance * out.alpha;
  const float next = __fmaf_rn(-transmittance, out.alpha, transmittance);
  const bool saturated = next <= static_cast<float>(kMinTransmittance);
  out.contributes = sample.touched[p] && !saturated;
  out.finished = saturated && transmittance > 0.0f;
  out.weight = saturated ? 0.0f : weight;
  transmittance = saturated ? -fabsf(transmittance) : next;
  return out;
}

/// Ballot of the 32 splats from `base` that touch the warp's block.
template <int kCount>
__device__ inline unsigned touching_mask(const Batch<kCount>& batch, int base) {
  const int warp = static_cast<int>(threadIdx.x) / kWarp;
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  return __ballot_sync(kAllLanes, (batch.splats[base + lane].blocks >> warp & 1U) != 0);
}

/// Calls f(index, splat, sample) for the splats of a batch from `base` on that touch the warp's
/// block, two at a time to overlap their latency.
inline constexpr unsigned kHighestBit = 1U << 31U;
template <int kCount, typename F>
__device__ inline void for_each_touching(const Batch<kCount>& batch, int base,
                                         const PixelPair& pixels, F&& f) {
  // Counting leading zeros takes half of the instructions of finding the lowest bit.
  unsigned left = __brev(touching_mask(batch, base));
  while (left != 0) {
    const int first_zeros = __clz(static_cast<int>(left));
    left ^= kHighestBit >> first_zeros;
    const bool has_second = left != 0;
    const int second_zeros = has_second ? __clz(static_cast<int>(left)) : first_zeros;
    left &= ~(kHighestBit >> second_zeros);
    const int first = base + first_zeros;
    const int second = base + second_zeros;
    const SplatData a = batch.load(first);
    const SplatData b = batch.load(second);
    const AlphaSample sample_a = sample_alpha(a, pixels);
    const AlphaSample sample_b = sample_alpha(b, pixels);
    f(first, a, sample_a);
    if (has_second) f(second, b, sample_b);
  }
}

__device__ inline bool any_live(const float (&transmittance)[kPixels]) {
  return transmittance[0] > 0.0f || transmittance[1] > 0.0f;
}

}  // namespace apvi::gaussians::cuda
