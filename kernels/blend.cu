// SPDX-License-Identifier: BSD-3-Clause
// Draws the splats of each tile front to back.
#include "tile_walk.cuh"

namespace apvi::splat::cuda {
namespace {

constexpr int kBatch = kThreads;

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
      for_each_touching(batch, base, place, [&](int, const Drawable&, const Reach& reach) {
        for (int p = 0; p < kPixels; ++p) pass(reach, p, light[p]);
      });
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
      const auto draw = [&](int at, const Drawable& s, const Reach& reach) {
        int best = 0;
#pragma unroll
        for (int p = 0; p < kPixels; ++p) {
          const Share share = pass(reach, p, light[p]);
          sum[p][0] = fmaf(share.weight, s.red, sum[p][0]);
          sum[p][1] = fmaf(share.weight, s.green, sum[p][1]);
          sum[p][2] = fmaf(share.weight, s.blue, sum[p][2]);
          sum[p][3] = fmaf(share.weight, s.z, sum[p][3]);
          best =
              max(best, share.seen && !share.drawn ? kFinishedOnly : __float_as_int(share.weight));
        }
        best = __reduce_max_sync(kAllLanes, best);
        if (threadIdx.x % kWarp == 0 && best != 0) atomicMax(weights + at, best);
      };
      for_each_touching(batch, base, place, draw);
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
  const std::uint32_t last = bins.chunk_begin[tile + 1];
#pragma unroll 4
  for (std::uint32_t k = bins.chunk_begin[tile]; k < last; ++k) {
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

}  // namespace

cudaError_t launch_blend(const Frame& frame, const SplatPointers& splats, const BinPointers& bins,
                         const ImagePointers& image, const ChunkPointers& chunks,
                         float* slot_weight, const StatisticsPointers& statistics,
                         cudaStream_t stream) {
  const unsigned blocks = chunk_capacity(splats.slot_capacity, bins.chunk_slots, frame.tiles());
  dim_kernel<<<blocks, kThreads, 0, stream>>>(frame, splats, bins, chunks);
  blend_kernel<<<blocks, kThreads, 0, stream>>>(frame, splats, bins, chunks, slot_weight);
  join_kernel<<<static_cast<unsigned>(frame.tiles()), kThreads, 0, stream>>>(frame, bins, chunks,
                                                                             image);
  weigh_kernel<<<(splats.capacity + kThreads - 1) / kThreads, kThreads, 0, stream>>>(
      splats, slot_weight, statistics.max_weight);
  return cudaGetLastError();
}

}  // namespace apvi::splat::cuda
