// SPDX-License-Identifier: BSD-3-Clause
// Draws the splats of each tile front to back, and the derivative by the same walk again. A warp
// has a block of 8x8 pixels, two to a thread, and looks only at splats whose ellipse touches it.
#include "gaussian_rows.cuh"

namespace apvi::splat::cuda {
namespace {

constexpr int kThreads = kTileWarps * kWarp;
constexpr int kBlock = 8;  // [px]
constexpr int kPixels = 2;
constexpr int kBatch = kThreads;
constexpr int kBackwardBatch = 64;
/// Instead of a weight: no pixel has the splat, but some were finished before it, which the walk
/// back must know. Less than any weight when compared as integers.
constexpr int kFinishedOnly = 1;

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
    begin = bins.tile_begin[tile] + (id - first) * kChunkSlots;
    end = min(min(bins.tile_begin[tile + 1], begin + kChunkSlots), slot_capacity);
  }
  __device__ Corner corner(const Frame& frame) const {
    return {tile % frame.tiles_x() * kTileSize, tile / frame.tiles_x() * kTileSize};
  }
};

/// Bits of the blocks of the tile that the ellipse touches: left and right, then those below.
__device__ unsigned find_blocks(const Splat<float>& s, Corner tile, const Frame& frame) {
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

__device__ float exp2_fast(float x) {
  float y;
  asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
}

/// One splat at one pixel. Products and sums are named, so that both walks find the same bits.
struct Share {
  float uncut, alpha, weight;
  bool drawn, finished;
};
__device__ Share pass(const Drawable& s, float dx, float dy, float& light) {
  const float flat = __fmaf_rn(s.e_xx, __fmul_rn(dx, dx), s.e_0);
  const float shear = __fmul_rn(s.e_xy, dx);
  const float e = __fmaf_rn(dy, __fmaf_rn(dy, s.e_yy, shear), flat);
  Share out = {};
  const bool seen = e >= static_cast<float>(kLog2MinAlpha) && light > 0.0f;
  if (!seen) return out;
  out.uncut = exp2_fast(e);
  out.alpha = fminf(out.uncut, static_cast<float>(kMaxAlpha));
  const float next = __fmaf_rn(-light, out.alpha, light);
  out.drawn = next > static_cast<float>(kMinTransmittance);
  out.finished = !out.drawn;
  out.weight = out.drawn ? __fmul_rn(light, out.alpha) : 0.0f;
  light = out.drawn ? next : -light;
  return out;
}

template <int kCount, bool kDrawnOnly>
__device__ void fill(Batch<kCount>& batch, const Frame& frame, Corner tile,
                     const SplatPointers& splats, const BinPointers& bins, std::uint32_t begin,
                     std::uint32_t end, const float* slot_weight) {
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
__device__ unsigned touching(const Batch<kCount>& batch, int base) {
  const int warp = static_cast<int>(threadIdx.x) / kWarp;
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  return __ballot_sync(kAllLanes, (batch.blocks[base + lane] >> warp & 1U) != 0);
}

/// Light that a chunk starts with; negative: finished before, or no pixel of the image.
__device__ void light_before(const Chunk& chunk, const Place& place, const Frame& frame,
                             const ChunkPointers& chunks, float (&light)[kPixels]) {
  for (int p = 0; p < kPixels; ++p) light[p] = place.inside(frame, p) ? 1.0f : -1.0f;
  for (std::uint32_t k = chunk.first; k < chunk.id; ++k) {
    const float2 through = chunks.through[k * kThreads + threadIdx.x];
    light[0] *= through.x;
    light[1] *= through.y;
  }
  for (float& x : light) {
    if (x <= static_cast<float>(kMinTransmittance)) x = -1.0f;
  }
}

__device__ bool any_live(const float (&light)[kPixels]) {
  return light[0] > 0.0f || light[1] > 0.0f;
}

/// How much light each chunk but the last lets through. Where it is less than a pixel is drawn for,
/// it does not matter how much.
__global__ void __launch_bounds__(kThreads)
    dim_kernel(Frame frame, SplatPointers splats, BinPointers bins, ChunkPointers chunks) {
  __shared__ Batch<kBatch> batch;
  const Chunk chunk(frame, bins, splats.slot_capacity);
  if (chunk.none || chunk.last) return;
  const Corner tile = chunk.corner(frame);
  const Place place(tile);
  float light[kPixels];
  for (int p = 0; p < kPixels; ++p) light[p] = place.inside(frame, p) ? 1.0f : -1.0f;
  for (std::uint32_t begin = chunk.begin; begin < chunk.end; begin += kBatch) {
    if (__syncthreads_or(any_live(light)) == 0) break;
    fill<kBatch, false>(batch, frame, tile, splats, bins, begin, chunk.end, nullptr);
    __syncthreads();
    const int count = min(kBatch, static_cast<int>(chunk.end - begin));
    for (int base = 0; base < count; base += kWarp) {
      for (unsigned left = touching(batch, base); left != 0; left &= left - 1) {
        const Drawable s = batch.get(base + __ffs(static_cast<int>(left)) - 1);
        const float dx = place.fx - s.u;
#pragma unroll
        for (int p = 0; p < kPixels; ++p) {
          pass(s, dx, place.fy + static_cast<float>(p * (kBlock / kPixels)) - s.v, light[p]);
        }
      }
    }
  }
  for (float& x : light) x = x > 0.0f ? x : 0.0f;
  chunks.through[chunk.id * kThreads + threadIdx.x] = make_float2(light[0], light[1]);
}

__global__ void __launch_bounds__(kThreads)
    blend_kernel(Frame frame, SplatPointers splats, BinPointers bins, ChunkPointers chunks,
                 float* slot_weight) {
  __shared__ Batch<kBatch> batch;
  __shared__ int weights[kBatch];
  const Chunk chunk(frame, bins, splats.slot_capacity);
  if (chunk.none) return;
  const Corner tile = chunk.corner(frame);
  const Place place(tile);
  float light[kPixels];
  float sum[kPixels][4] = {};
  light_before(chunk, place, frame, chunks, light);
  const bool live_before[kPixels] = {light[0] > 0.0f, light[1] > 0.0f};
  for (std::uint32_t begin = chunk.begin; begin < chunk.end; begin += kBatch) {
    if (__syncthreads_or(any_live(light)) == 0) break;
    fill<kBatch, false>(batch, frame, tile, splats, bins, begin, chunk.end, nullptr);
    weights[threadIdx.x] = 0;
    __syncthreads();
    const int count = min(kBatch, static_cast<int>(chunk.end - begin));
    for (int base = 0; base < count; base += kWarp) {
      if (!__any_sync(kAllLanes, any_live(light))) break;
      for (unsigned left = touching(batch, base); left != 0; left &= left - 1) {
        const int at = base + __ffs(static_cast<int>(left)) - 1;
        const Drawable s = batch.get(at);
        const float dx = place.fx - s.u;
        int best = 0;
#pragma unroll
        for (int p = 0; p < kPixels; ++p) {
          const float dy = place.fy + static_cast<float>(p * (kBlock / kPixels)) - s.v;
          const Share share = pass(s, dx, dy, light[p]);
          sum[p][0] = fmaf(share.weight, s.red, sum[p][0]);
          sum[p][1] = fmaf(share.weight, s.green, sum[p][1]);
          sum[p][2] = fmaf(share.weight, s.blue, sum[p][2]);
          sum[p][3] = fmaf(share.weight, s.z, sum[p][3]);
          best = max(best, share.finished ? kFinishedOnly : __float_as_int(share.weight));
        }
        best = __reduce_max_sync(kAllLanes, best);
        if (threadIdx.x % kWarp == 0 && best != 0) atomicMax(weights + at, best);
      }
    }
    __syncthreads();
    if (weights[threadIdx.x] != 0) {
      slot_weight[batch.slot[threadIdx.x]] = __int_as_float(weights[threadIdx.x]);
    }
  }
  const std::uint32_t to = chunk.id * kThreads + threadIdx.x;
  chunks.end[to] = make_float2(live_before[0] ? light[0] : 0.0f, live_before[1] ? light[1] : 0.0f);
  for (int p = 0; p < kPixels; ++p) {
    chunks.sums[kPixels * to + p] = make_float4(sum[p][0], sum[p][1], sum[p][2], sum[p][3]);
  }
}

/// One block a tile: adds up what its chunks have.
__global__ void __launch_bounds__(kThreads)
    join_kernel(Frame frame, BinPointers bins, ChunkPointers chunks, ImagePointers image) {
  const auto tile = static_cast<int>(blockIdx.x);
  const Place place({tile % frame.tiles_x() * kTileSize, tile / frame.tiles_x() * kTileSize});
  float through[kPixels] = {1.0f, 1.0f};
  float sum[kPixels][4] = {};
  for (std::uint32_t k = bins.chunk_begin[tile]; k < bins.chunk_begin[tile + 1]; ++k) {
    const float2 end = chunks.end[k * kThreads + threadIdx.x];
    if (end.x != 0.0f) through[0] = fabsf(end.x);
    if (end.y != 0.0f) through[1] = fabsf(end.y);
    for (int p = 0; p < kPixels; ++p) {
      const float4 part = chunks.sums[kPixels * (k * kThreads + threadIdx.x) + p];
      sum[p][0] += part.x;
      sum[p][1] += part.y;
      sum[p][2] += part.z;
      sum[p][3] += part.w;
    }
  }
  for (int p = 0; p < kPixels; ++p) {
    if (!place.inside(frame, p)) continue;
    const std::int64_t to = place.index(frame, p);
    const float alpha = 1.0f - through[p];
    for (int c = 0; c < 3; ++c) {
      image.color[3 * to + c] = fmaf(through[p], image.background[c], sum[p][c]);
    }
    image.alpha[to] = alpha;
    image.depth[to] = alpha > 0.0f ? sum[p][3] / alpha : 0.0f;
  }
}

/// The largest weight of every Gaussian that shows.
__global__ void weigh_kernel(SplatPointers splats, const float* slot_weight, float* max_weight) {
  const std::uint32_t i = blockIdx.x * kThreads + threadIdx.x;
  if (i >= min(splats.counts->splats, splats.capacity)) return;
  const SlotRange slots = splats.slots[i];
  int best = 0;
  for (std::uint32_t k = 0; k < slots.count && slots.begin + k < splats.slot_capacity; ++k) {
    best = max(best, __float_as_int(slot_weight[slots.begin + k]));
  }
  max_weight[splats.gaussian[i]] = best > kFinishedOnly ? __int_as_float(best) : 0.0f;
}

/// What the walk back needs of a pixel: derivatives of the loss by colour, by the sum of weighted
/// depths, by alpha; and the part of the weighted sum of all that is still to come.
struct PixelGradient {
  float color[3];
  float depth, alpha, rest;
};

__device__ PixelGradient gradient_at(const ImagePointers& image, const ImageGradientPointers& grad,
                                     std::int64_t at) {
  PixelGradient out = {};
  const float opacity = image.alpha[at];
  if (grad.alpha != nullptr) out.alpha = grad.alpha[at];
  out.rest = out.alpha * opacity;
  if (grad.depth != nullptr) {
    out.depth = opacity > 0.0f ? grad.depth[at] / opacity : 0.0f;
    out.alpha -= out.depth * image.depth[at];
  }
  for (int c = 0; c < 3; ++c) {
    out.color[c] = grad.color[3 * at + c];
    out.rest = fmaf(out.color[c], image.color[3 * at + c], out.rest);
  }
  return out;
}

/// Sums ten values over a warp: at every step each half of the lanes keeps half of the values. The
/// sum of value k ends in the lanes that `holder` names.
__device__ float sum_ten(const float (&v)[kSlotFloats]) {
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  const auto swap = [lane](float low, float high, int bit) {
    const bool upper = (lane & bit) != 0;
    const float give = upper ? low : high;
    return (upper ? high : low) + __shfl_xor_sync(kAllLanes, give, bit);
  };
  float five[5];
  for (int k = 0; k < 5; ++k) five[k] = swap(v[k], v[k + 5], 16);
  const float three[3] = {swap(five[0], five[3], 8), swap(five[1], five[4], 8),
                          swap(five[2], 0.0f, 8)};
  const float two[2] = {swap(three[0], three[2], 4), swap(three[1], 0.0f, 4)};
  float one = swap(two[0], two[1], 2);
  one += __shfl_xor_sync(kAllLanes, one, 1);
  return one;
}
/// Which value a lane holds after `sum_ten`; -1: none.
__device__ int value_of_lane() {
  const unsigned lane = threadIdx.x % kWarp;
  if ((lane & 1U) != 0) return -1;
  const int two = (lane & 2U) != 0 ? 1 : 0;
  int three = two;
  if ((lane & 4U) != 0) three = two == 0 ? 2 : 3;  // of three, the fourth is none
  if (three == 3) return -1;
  int five = three;
  if ((lane & 8U) != 0) five = three == 2 ? 5 : three + 3;
  if (five == 5) return -1;
  return (lane & 16U) != 0 ? five + 5 : five;
}

struct BackwardShared {
  Batch<kBackwardBatch> batch;
  float sums[kTileWarps][kBackwardBatch][kSlotFloats];
  unsigned long long written[kTileWarps];
};

/// One splat's derivatives, summed over the warp's block; whether any pixel has it.
__device__ bool walk_back(const Drawable& s, const Place& place, float (&light)[kPixels],
                          PixelGradient (&grad)[kPixels], float (&sum)[kSlotFloats]) {
  const float dx = place.fx - s.u;
  for (float& x : sum) x = 0.0f;
  bool any = false;
#pragma unroll
  for (int p = 0; p < kPixels; ++p) {
    const float dy = place.fy + static_cast<float>(p * (kBlock / kPixels)) - s.v;
    const Share share = pass(s, dx, dy, light[p]);
    if (!share.drawn) continue;
    any = true;
    PixelGradient& g = grad[p];
    float value = fmaf(g.color[0], s.red, g.alpha);
    value = fmaf(g.color[1], s.green, value);
    value = fmaf(g.color[2], s.blue, value);
    value = fmaf(g.depth, s.z, value);
    g.rest = fmaf(-share.weight, value, g.rest);
    // By ln(alpha), which is weight (value - what lies behind); nothing where alpha is cut.
    const float behind = __fdividef(g.rest * share.alpha, 1.0f - share.alpha);
    const float v =
        share.uncut <= static_cast<float>(kMaxAlpha) ? fmaf(share.weight, value, -behind) : 0.0f;
    for (int c = 0; c < 3; ++c) sum[c] = fmaf(share.weight, g.color[c], sum[c]);
    sum[3] = fmaf(share.weight, g.depth, sum[3]);
    sum[4] += v;
    sum[7] = fmaf(v, dy, sum[7]);
    sum[8] = fmaf(v * dy, dy, sum[8]);
  }
  sum[5] = sum[4] * dx;
  sum[6] = sum[5] * dx;
  sum[9] = sum[7] * dx;
  return any;
}

/// Adds up what the warps found for the splats of a batch, in their order.
__device__ void store_batch(const BackwardShared& shared, int count, float* slot_gradient) {
  for (int k = static_cast<int>(threadIdx.x); k < count * kSlotFloats; k += kThreads) {
    const int at = k / kSlotFloats;
    const int value = k % kSlotFloats;
    float sum = 0.0f;
    for (int warp = 0; warp < kTileWarps; ++warp) {
      if ((shared.written[warp] >> at & 1U) != 0) sum += shared.sums[warp][at][value];
    }
    slot_gradient[static_cast<std::int64_t>(shared.batch.slot[at]) * kSlotFloats + value] = sum;
  }
}

/// Takes what the chunks before have from what is still to come.
__device__ void take_before(const Chunk& chunk, const ChunkPointers& chunks,
                            PixelGradient (&grad)[kPixels]) {
  float start[kPixels] = {1.0f, 1.0f};
  for (std::uint32_t k = chunk.first; k < chunk.id; ++k) {
    const float2 ends = chunks.end[k * kThreads + threadIdx.x];
    const float end[kPixels] = {fabsf(ends.x), fabsf(ends.y)};
    for (int p = 0; p < kPixels; ++p) {
      const float4 part = chunks.sums[kPixels * (k * kThreads + threadIdx.x) + p];
      PixelGradient& g = grad[p];
      g.rest -= part.x * g.color[0] + part.y * g.color[1] + part.z * g.color[2] + part.w * g.depth +
                (start[p] - end[p]) * g.alpha;
      start[p] = end[p];
    }
  }
}

/// Sums over the warp of what the background has to do with the loss.
__device__ void store_background(const float (&background)[kBackgroundScalars], int tile,
                                 float* partials) {
  const int warp = static_cast<int>(threadIdx.x) / kWarp;
  for (int c = 0; c < kBackgroundScalars; ++c) {
    float sum = background[c];
    for (int by = kWarp / 2; by > 0; by /= 2) sum += __shfl_xor_sync(kAllLanes, sum, by);
    if (threadIdx.x % kWarp == 0) {
      partials[(tile * kTileWarps + warp) * kBackgroundScalars + c] = sum;
    }
  }
}

__global__ void __launch_bounds__(kThreads)
    background_backward_kernel(Frame frame, ImagePointers image, const float* grad_color,
                               float* partials) {
  const auto tile = static_cast<int>(blockIdx.x);
  const Place place({tile % frame.tiles_x() * kTileSize, tile / frame.tiles_x() * kTileSize});
  float background[kBackgroundScalars] = {};
  for (int p = 0; p < kPixels; ++p) {
    if (!place.inside(frame, p)) continue;
    const std::int64_t at = place.index(frame, p);
    for (int c = 0; c < kBackgroundScalars; ++c) {
      background[c] += (1.0f - image.alpha[at]) * grad_color[3 * at + c];
    }
  }
  store_background(background, tile, partials);
}

__global__ void __launch_bounds__(kThreads)
    blend_backward_kernel(Frame frame, SplatPointers splats, BinPointers bins, ImagePointers image,
                          ChunkPointers chunks, const float* slot_weight,
                          ImageGradientPointers image_grad, float* slot_gradient) {
  __shared__ BackwardShared shared;
  const Chunk chunk(frame, bins, splats.slot_capacity);
  if (chunk.none) return;
  const Corner tile = chunk.corner(frame);
  const Place place(tile);
  const int warp = static_cast<int>(threadIdx.x) / kWarp;
  const int own_value = value_of_lane();
  float light[kPixels];
  PixelGradient grad[kPixels] = {};
  light_before(chunk, place, frame, chunks, light);
  for (int p = 0; p < kPixels; ++p) {
    if (place.inside(frame, p)) grad[p] = gradient_at(image, image_grad, place.index(frame, p));
  }
  take_before(chunk, chunks, grad);
  for (std::uint32_t begin = chunk.begin; begin < chunk.end; begin += kBackwardBatch) {
    if (__syncthreads_or(any_live(light)) == 0) break;
    fill<kBackwardBatch, true>(shared.batch, frame, tile, splats, bins, begin, chunk.end,
                               slot_weight);
    __syncthreads();
    const int count = min(kBackwardBatch, static_cast<int>(chunk.end - begin));
    unsigned long long written = 0;
    for (int base = 0; base < count; base += kWarp) {
      for (unsigned left = touching(shared.batch, base); left != 0; left &= left - 1) {
        const int at = base + __ffs(static_cast<int>(left)) - 1;
        float sum[kSlotFloats];
        const bool any = walk_back(shared.batch.get(at), place, light, grad, sum);
        if (!__any_sync(kAllLanes, any)) continue;
        written |= 1ULL << at;
        const float total = sum_ten(sum);
        if (own_value >= 0) shared.sums[warp][at][own_value] = total;
      }
    }
    if (threadIdx.x % kWarp == 0) shared.written[warp] = written;
    __syncthreads();
    store_batch(shared, count, slot_gradient);
  }
}

unsigned chunk_blocks(const Frame& frame, const SplatPointers& splats) {
  return chunk_capacity(splats.slot_capacity, frame.tiles());
}

}  // namespace

cudaError_t launch_blend(const Frame& frame, const SplatPointers& splats, const BinPointers& bins,
                         const ImagePointers& image, const ChunkPointers& chunks,
                         float* slot_weight, const StatisticsPointers& statistics,
                         cudaStream_t stream) {
  const unsigned blocks = chunk_blocks(frame, splats);
  dim_kernel<<<blocks, kThreads, 0, stream>>>(frame, splats, bins, chunks);
  blend_kernel<<<blocks, kThreads, 0, stream>>>(frame, splats, bins, chunks, slot_weight);
  join_kernel<<<static_cast<unsigned>(frame.tiles()), kThreads, 0, stream>>>(frame, bins, chunks,
                                                                             image);
  weigh_kernel<<<(splats.capacity + kThreads - 1) / kThreads, kThreads, 0, stream>>>(
      splats, slot_weight, statistics.max_weight);
  return cudaGetLastError();
}

cudaError_t launch_blend_backward(const Frame& frame, const SplatPointers& splats,
                                  const BinPointers& bins, const ImagePointers& image,
                                  const ChunkPointers& chunks, const float* slot_weight,
                                  const ImageGradientPointers& grad, const BackwardScratch& scratch,
                                  cudaStream_t stream) {
  blend_backward_kernel<<<chunk_blocks(frame, splats), kThreads, 0, stream>>>(
      frame, splats, bins, image, chunks, slot_weight, grad, scratch.slot_gradient);
  background_backward_kernel<<<static_cast<unsigned>(frame.tiles()), kThreads, 0, stream>>>(
      frame, image, grad.color, scratch.background_partials);
  return cudaGetLastError();
}

}  // namespace apvi::splat::cuda
