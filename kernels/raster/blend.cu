// SPDX-License-Identifier: BSD-3-Clause
// Front-to-back blending of the splats of each tile. The chunks of a tile are blended concurrently:
// all but the first and the last first publish their transmittance; once those before a chunk have
// done so, it knows its starting transmittance and blends its splats, still in shared memory.
// Chunks start in an order in which none waits for a later one; most chunks behind the one that
// finished the tile's last pixels are skipped. The last chunk to finish combines the chunks of the
// tile.
#include <type_traits>

#include "kernels/raster/tile_walk.cuh"

namespace apvi::gaussians::cuda {
namespace {

/// Thread blocks per multiprocessor; more would leave too few registers.
constexpr int kDrawBlocks = 10;

/// Per-splat results of a chunk for the statistics and the backward pass.
template <int kSlots>
struct ChunkStatistics {
  int weights[kSlots];              // largest weight
  unsigned blocks[kSlots];          // mask of the tile's blocks with a contribution
  std::uint32_t found[kTileWarps];  // contributing splats, counted per warp
};
struct Empty {};

/// `kKeep`: keep the state for the backward pass.
template <int kSlots, bool kKeep>
struct DrawShared {
  Batch<kSlots + 1> batch;  // the last is an empty splat
  std::uint32_t pairs[kTileWarps][kSlots / 2];
  std::conditional_t<kKeep, ChunkStatistics<kSlots>, Empty> statistics;
  std::uint32_t word;  // broadcast value
};

/// Loads the splats of a chunk, padded to a multiple of 32 with splats that touch no block.
template <int kSlots, bool kKeep>
__device__ void load_chunk(const Chunk& chunk, const Frame& frame, const SplatPointers& splats,
                           const BinPointers& bins, DrawShared<kSlots, kKeep>& shared) {
  const int count = chunk.size();
  if (threadIdx.x == 0) shared.batch.store(kSlots, {.e_0 = -INFINITY}, 0, 0);
  for (auto at = static_cast<int>(threadIdx.x); at < (count + kWarp - 1) / kWarp * kWarp;
       at += kThreads) {
    if constexpr (kKeep) {
      shared.statistics.weights[at] = 0;
      shared.statistics.blocks[at] = 0;
    }
    shared.batch.clear(at);
    if (at >= count) continue;
    const std::uint32_t slot = bins.tile_slots[chunk.begin + at];
    const Splat<float> s = splats.splats[kKeep ? bins.slot_splat[slot] : slot];
    shared.batch.store(at, s, slot, find_blocks(s, chunk.origin(frame), frame));
  }
}

/// Lists the splats of a chunk that touch the warp's block, two per word; returns the number of
/// words. An odd count is padded with the empty splat.
template <int kSlots, bool kKeep>
__device__ int list_touching(DrawShared<kSlots, kKeep>& shared, int count) {
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  auto* const pairs = shared.pairs[threadIdx.x / kWarp];
  auto* const list = reinterpret_cast<std::uint16_t*>(pairs);
  int listed = 0;
  for (int base = 0; base < count; base += kWarp) {
    const unsigned touch = touching_mask(shared.batch, base);
    if ((touch >> lane & 1U) != 0) {
      list[listed + __popc(touch & ((1U << lane) - 1))] = static_cast<std::uint16_t>(base + lane);
    }
    listed += __popc(touch);
  }
  if (listed % 2 != 0 && lane == 0) list[listed] = kSlots;
  __syncwarp();
  return (listed + 1) / 2;
}

/// Calls f(index, splat, sample) for the listed splats while the warp-uniform `more()` holds, which
/// is checked periodically. Two splats are processed at a time to overlap their latency.
template <int kSlots, bool kKeep, typename More, typename F>
__device__ void for_each_listed(const DrawShared<kSlots, kKeep>& shared, int words,
                                const PixelPair& pixels, More&& more, F&& f) {
  constexpr int kUnroll = 8;
  const auto* const pairs = shared.pairs[threadIdx.x / kWarp];
  for (int base = 0; base < words; base += kUnroll) {
    if (!more()) return;
    const int end = min(base + kUnroll, words);
    for (int k = base; k < end; ++k) {
      const auto first = static_cast<int>(pairs[k] & 0xffffU);
      const auto second = static_cast<int>(pairs[k] >> 16U);
      const SplatData a = shared.batch.load(first);
      const SplatData b = shared.batch.load(second);
      const AlphaSample sample_a = sample_alpha(a, pixels);
      const AlphaSample sample_b = sample_alpha(b, pixels);
      f(first, a, sample_a);
      f(second, b, sample_b);
    }
  }
}

/// Broadcasts a word of thread 0 to all threads.
__device__ std::uint32_t broadcast_first(std::uint32_t word, std::uint32_t& shared) {
  __syncthreads();
  if (threadIdx.x == 0) shared = word;
  __syncthreads();
  return shared;
}

__device__ std::uint32_t load_volatile(const std::uint32_t* at) {
  return *static_cast<const volatile std::uint32_t*>(at);
}

/// Publishes a chunk's transmittance for the chunks behind it.
__device__ void publish_transmittance(const Chunk& chunk, const BinPointers& bins,
                                      const ChunkPointers& chunks,
                                      const float (&transmittance)[kPixels]) {
  chunks.transmittance[chunk.id * kThreads + threadIdx.x] =
      make_float2(fmaxf(transmittance[0], 0.0f), fmaxf(transmittance[1], 0.0f));
  __threadfence();
  __syncthreads();
  if (threadIdx.x == 0) *static_cast<volatile std::uint32_t*>(bins.drawing.ready + chunk.id) = 1;
}

/// Transmittance of a chunk alone; zero below the termination threshold.
template <int kSlots, bool kKeep>
__device__ void compute_chunk_transmittance(const DrawShared<kSlots, kKeep>& shared, int words,
                                            const PixelPair& pixels,
                                            float (&transmittance)[kPixels]) {
  constexpr auto kThreshold = static_cast<float>(kMinTransmittance);
  const auto more = [&] {
    return __any_sync(kAllLanes, transmittance[0] > kThreshold || transmittance[1] > kThreshold) !=
           0;
  };
  for_each_listed(shared, words, pixels, more,
                  [&](int, const SplatData&, const AlphaSample& sample) {
#pragma unroll
                    for (int p = 0; p < kPixels; ++p) {
                      const float alpha = fminf(sample.raw_alpha[p], static_cast<float>(kMaxAlpha));
                      const float next = __fmaf_rn(-transmittance[p], alpha, transmittance[p]);
                      transmittance[p] = sample.touched[p] ? next : transmittance[p];
                    }
                  });
  for (float& x : transmittance) x = x > kThreshold ? x : 0.0f;
}

/// Starting transmittance of a chunk; negative: finished before or outside the image. Waits for the
/// chunks before it.
__device__ void load_starting_transmittance(const Chunk& chunk, const BinPointers& bins,
                                            const ChunkPointers& chunks,
                                            float (&transmittance)[kPixels]) {
  for (std::uint32_t k = chunk.first + threadIdx.x; k < chunk.id; k += kThreads) {
    while (load_volatile(bins.drawing.ready + k) == 0) {
    }
  }
  __threadfence();
  __syncthreads();
#pragma unroll 8
  for (std::uint32_t k = chunk.first; k < chunk.id; ++k) {
    const float2 before = __ldcg(chunks.transmittance + k * kThreads + threadIdx.x);
    transmittance[0] *= before.x;
    transmittance[1] *= before.y;
  }
  for (float& x : transmittance) {
    if (x <= static_cast<float>(kMinTransmittance)) x = -1.0f;
  }
}

/// Blends the splats of a chunk; keeps the largest weight of each and the blocks it contributes to.
template <int kSlots, bool kKeep>
__device__ void blend(DrawShared<kSlots, kKeep>& shared, int words, const PixelPair& pixels,
                      float (&transmittance)[kPixels], float (&sum)[kPixels][4]) {
  const auto more = [&] { return __any_sync(kAllLanes, any_live(transmittance)) != 0; };
  const auto draw = [&](int at, const SplatData& s, const AlphaSample& sample) {
    int best = 0;
#pragma unroll
    for (int p = 0; p < kPixels; ++p) {
      const BlendStep step = blend_pixel(sample, p, transmittance[p]);
      sum[p][0] = fmaf(step.weight, s.red, sum[p][0]);
      sum[p][1] = fmaf(step.weight, s.green, sum[p][1]);
      sum[p][2] = fmaf(step.weight, s.blue, sum[p][2]);
      sum[p][3] = fmaf(step.weight, s.z, sum[p][3]);
      best = max(best, step.finished ? kFinishedOnly : __float_as_int(step.weight));
    }
    if constexpr (kKeep) {
      best = warp_max(best);
      if (threadIdx.x % kWarp == 0 && best != 0) {
        atomicMax(shared.statistics.weights + at, best);
        atomicOr(shared.statistics.blocks + at, 1U << (threadIdx.x / kWarp));
      }
    }
  };
  for_each_listed(shared, words, pixels, more, draw);
}

/// Stores the largest weights of a chunk's slots and of their Gaussians. Contributing splats are
/// compacted to the front of the chunk's slots for the backward pass.
template <int kSlots>
__device__ void store_weights(DrawShared<kSlots, true>& shared, const Chunk& chunk,
                              const SplatPointers& splats, const BinPointers& bins,
                              float* slot_weight, float* max_weight) {
  const int warp = static_cast<int>(threadIdx.x) / kWarp;
  const unsigned below = (1U << threadIdx.x % kWarp) - 1;
  std::uint32_t before = chunk.begin;
  for (int base = 0; base < chunk.size(); base += kThreads) {
    const int at = base + static_cast<int>(threadIdx.x);
    const int weight = at < chunk.size() ? shared.statistics.weights[at] : 0;
    const unsigned contributes = __ballot_sync(kAllLanes, weight != 0);
    if (threadIdx.x % kWarp == 0) shared.statistics.found[warp] = __popc(contributes);
    __syncthreads();
    std::uint32_t to = before + __popc(contributes & below);
    for (int w = 0; w < kTileWarps; ++w) {
      if (w < warp) to += shared.statistics.found[w];
      before += shared.statistics.found[w];
    }
    const std::uint32_t slot = at < chunk.size() ? shared.batch.splats[at].slot : 0;
    if (at < chunk.size()) slot_weight[slot] = __int_as_float(weight);
    if (weight != 0) {
      const std::uint32_t splat = bins.slot_splat[slot];
      bins.tile_slots[to] = slot;
      bins.tile_draws[to] = shared.statistics.blocks[at] << kSplatBits | splat;
      auto* const best = reinterpret_cast<int*>(max_weight + splats.gaussian[splat]);
      if (weight != kFinishedOnly) atomicMax(best, weight);
    }
    __syncthreads();
  }
  if (threadIdx.x == 0) bins.chunk_draw_count[chunk.id] = before - chunk.begin;
}

__device__ void store_image(const PixelPair& pixels, const Frame& frame, const ImagePointers& image,
                            const float (&transmittance)[kPixels], const float (&sum)[kPixels][4]) {
  for (int p = 0; p < kPixels; ++p) {
    if (!pixels.inside(frame, p)) continue;
    const std::int64_t to = pixels.index(frame, p);
    const float alpha = 1.0f - transmittance[p];
    for (int c = 0; c < 3; ++c) {
      image.color[3 * to + c] = fmaf(transmittance[p], image.background[c], sum[p][c]);
    }
    image.alpha[to] = alpha;
    image.depth[to] = alpha > 0.0f ? sum[p][3] / alpha : 0.0f;
  }
}

/// Result of a chunk for a thread's pixels.
struct Part {
  float2 end;
  float4 sums[kPixels];
};

/// Combines the chunks of a tile and, with kKeep, stores in each the sums of those before it.
template <bool kKeep>
__device__ void combine_chunks(const Chunk& chunk, const PixelPair& pixels, const Frame& frame,
                               const BinPointers& bins, const ChunkPointers& chunks,
                               const ImagePointers& image) {
  constexpr std::uint32_t kUnroll = 2;
  float transmittance[kPixels] = {1.0f, 1.0f};
  float sum[kPixels][4] = {};
  const std::uint32_t last = min(chunk.last, load_volatile(bins.last_visible_chunk + chunk.tile));
  for (std::uint32_t k = chunk.first; k <= last; k += kUnroll) {
    Part parts[kUnroll] = {};
#pragma unroll
    for (std::uint32_t j = 0; j < kUnroll; ++j) {
      if (k + j > last) continue;
      const std::uint32_t at = (k + j) * kThreads + threadIdx.x;
      parts[j].end = __ldcg(chunks.end + at);
      for (int p = 0; p < kPixels; ++p) {
        parts[j].sums[p] = __ldcg(chunks.sums + kPixels * at + p);
      }
    }
#pragma unroll
    for (std::uint32_t j = 0; j < kUnroll; ++j) {
      if (k + j > last) continue;
      const std::uint32_t at = (k + j) * kThreads + threadIdx.x;
      if (parts[j].end.x != 0.0f) transmittance[0] = fabsf(parts[j].end.x);
      if (parts[j].end.y != 0.0f) transmittance[1] = fabsf(parts[j].end.y);
      for (int p = 0; p < kPixels; ++p) {
        if constexpr (kKeep) {
          chunks.sums[kPixels * at + p] = make_float4(sum[p][0], sum[p][1], sum[p][2], sum[p][3]);
        }
        sum[p][0] += parts[j].sums[p].x;
        sum[p][1] += parts[j].sums[p].y;
        sum[p][2] += parts[j].sums[p].z;
        sum[p][3] += parts[j].sums[p].w;
      }
    }
  }
  store_image(pixels, frame, image, transmittance, sum);
}

/// Whether this is the last chunk of the tile to finish.
__device__ bool is_last_blended(const Chunk& chunk, const BinPointers& bins,
                                std::uint32_t& shared) {
  __threadfence();
  __syncthreads();
  std::uint32_t before = 0;
  if (threadIdx.x == 0) before = atomicAdd(bins.drawing.finished + chunk.tile, 1U);
  const bool out = broadcast_first(before, shared) == chunk.last - chunk.first;
  __threadfence();
  return out;
}

template <int kSlots, bool kKeep>
__global__ void __launch_bounds__(kThreads, resident_blocks(kThreads, kDrawBlocks))
    draw_kernel(Frame frame, SplatPointers splats, BinPointers bins, ImagePointers image,
                ChunkPointers chunks, float* slot_weight, float* max_weight) {
  __shared__ DrawShared<kSlots, kKeep> shared;
  std::uint32_t ticket = 0;
  if (threadIdx.x == 0) ticket = atomicAdd(bins.drawing.started, 1U);
  const Chunk chunk(frame, bins, splats.slot_capacity, broadcast_first(ticket, shared.word));
  if (chunk.is_empty) return;
  const TileOrigin tile = chunk.origin(frame);
  const PixelPair pixels(tile);
  const bool first = chunk.id == chunk.first;
  const bool last = chunk.id == chunk.last;
  const int count = chunk.size();
  const std::uint32_t to = chunk.id * kThreads + threadIdx.x;
  float transmittance[kPixels];
  float sum[kPixels][4] = {};
  for (int p = 0; p < kPixels; ++p) transmittance[p] = pixels.inside(frame, p) ? 1.0f : -1.0f;
  const bool is_occluded =
      broadcast_first(load_volatile(bins.last_visible_chunk + chunk.tile), shared.word) < chunk.id;
  if (is_occluded) {
    if (!last) publish_transmittance(chunk, bins, chunks, {0.0f, 0.0f});
    if constexpr (kKeep) {
      for (auto at = static_cast<int>(threadIdx.x); at < count; at += kThreads) {
        slot_weight[bins.tile_slots[chunk.begin + at]] = 0.0f;
      }
    }
  } else {
    load_chunk(chunk, frame, splats, bins, shared);
    __syncthreads();
    const int words = list_touching(shared, count);
    if (!first && !last) {
      float own_transmittance[kPixels] = {transmittance[0], transmittance[1]};
      compute_chunk_transmittance(shared, words, pixels, own_transmittance);
      publish_transmittance(chunk, bins, chunks, own_transmittance);
    }
    if (!first) load_starting_transmittance(chunk, bins, chunks, transmittance);
    if (kKeep && !first) chunks.start[to] = make_float2(transmittance[0], transmittance[1]);
    const bool live_before[kPixels] = {transmittance[0] > 0.0f, transmittance[1] > 0.0f};
    const bool was_live = __syncthreads_or(any_live(transmittance)) != 0;
    blend(shared, words, pixels, transmittance, sum);
    if (first && !last) publish_transmittance(chunk, bins, chunks, transmittance);
    if (__syncthreads_or(any_live(transmittance)) == 0 && was_live && threadIdx.x == 0) {
      atomicMin(bins.last_visible_chunk + chunk.tile, chunk.id);
    }
    if constexpr (kKeep) store_weights(shared, chunk, splats, bins, slot_weight, max_weight);
    if (first && last) {
      for (float& x : transmittance) x = fabsf(x);
      return store_image(pixels, frame, image, transmittance, sum);
    }
    chunks.end[to] = make_float2(live_before[0] ? transmittance[0] : 0.0f,
                                 live_before[1] ? transmittance[1] : 0.0f);
    for (int p = 0; p < kPixels; ++p) {
      chunks.sums[kPixels * to + p] = make_float4(sum[p][0], sum[p][1], sum[p][2], sum[p][3]);
    }
  }
  if (!is_last_blended(chunk, bins, shared.word)) return;
  combine_chunks<kKeep>(chunk, pixels, frame, bins, chunks, image);
}

}  // namespace

cudaError_t launch_blend(const Frame& frame, const SplatPointers& splats, const BinPointers& bins,
                         const ImagePointers& image, const ChunkPointers& chunks,
                         float* slot_weight, const StatisticsPointers& statistics,
                         cudaStream_t stream) {
  const unsigned blocks = chunk_capacity(splats.slot_capacity, bins.chunk_slots, frame.tiles());
  const bool keep = slot_weight != nullptr;
  auto kernel = keep ? draw_kernel<kMaxChunkSlots, true> : draw_kernel<kMaxChunkSlots, false>;
  if (bins.chunk_slots == kMinChunkSlots) {
    kernel = keep ? draw_kernel<kMinChunkSlots, true> : draw_kernel<kMinChunkSlots, false>;
  }
  kernel<<<blocks, kThreads, 0, stream>>>(frame, splats, bins, image, chunks, slot_weight,
                                          statistics.max_weight);
  return cudaGetLastError();
}

}  // namespace apvi::gaussians::cuda
