// SPDX-License-Identifier: BSD-3-Clause
// Draws the splats of each tile front to back. The chunks of a tile's list are drawn side by side:
// each but the first and the last says first how much light it lets through, alone; when those
// before it have said so too, it knows what light it starts with and blends its splats, which are
// still in shared memory. Chunks begin in an order in which none waits for a later one, and of
// those behind a chunk that finished the tile's last pixels, most need not be drawn at all. Who is
// the last to be drawn adds the tile's chunks up.
#include <type_traits>

#include "tile_walk.cuh"

namespace apvi::splat::cuda {
namespace {

/// Of a multiprocessor; more of them leave too few registers.
constexpr int kDrawBlocks = 10;

/// Of each splat of a chunk: what the statistics and the walk back ask for.
template <int kSlots>
struct Seen {
  int weights[kSlots];              // the largest
  unsigned blocks[kSlots];          // of the tile's, in which a splat is drawn
  std::uint32_t found[kTileWarps];  // splats drawn, of which each warp counts some
};
struct Nothing {};

/// `kKeep`: not for the images alone.
template <int kSlots, bool kKeep>
struct DrawShared {
  Batch<kSlots + 1> batch;  // the last is no splat at all
  std::uint32_t pairs[kTileWarps][kSlots / 2];
  std::conditional_t<kKeep, Seen<kSlots>, Nothing> seen;
  std::uint32_t word;  // that a thread has for all
};

/// Fetches the splats of a chunk, a multiple of 32 of them; what there is not touches no block.
template <int kSlots, bool kKeep>
__device__ void fetch(const Chunk& chunk, const Frame& frame, const SplatPointers& splats,
                      const BinPointers& bins, DrawShared<kSlots, kKeep>& shared) {
  const int count = chunk.size();
  if (threadIdx.x == 0) shared.batch.put(kSlots, {.e_0 = -INFINITY}, 0, 0);
  for (auto at = static_cast<int>(threadIdx.x); at < (count + kWarp - 1) / kWarp * kWarp;
       at += kThreads) {
    if constexpr (kKeep) {
      shared.seen.weights[at] = 0;
      shared.seen.blocks[at] = 0;
    }
    shared.batch.put_none(at);
    if (at >= count) continue;
    const std::uint32_t slot = bins.tile_slots[chunk.begin + at];
    const Splat<float> s = splats.splats[kKeep ? bins.slot_splat[slot] : slot];
    shared.batch.put(at, s, slot, find_blocks(s, chunk.corner(frame), frame));
  }
}

/// Lists those of a chunk's splats that touch the warp's block, two to a word; returns how many
/// words. Where they are an odd number, the last one's neighbour is no splat.
template <int kSlots, bool kKeep>
__device__ int list_touching(DrawShared<kSlots, kKeep>& shared, int count) {
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  auto* const pairs = shared.pairs[threadIdx.x / kWarp];
  auto* const list = reinterpret_cast<std::uint16_t*>(pairs);
  int listed = 0;
  for (int base = 0; base < count; base += kWarp) {
    const unsigned touch = touching(shared.batch, base);
    if ((touch >> lane & 1U) != 0) {
      list[listed + __popc(touch & ((1U << lane) - 1))] = static_cast<std::uint16_t>(base + lane);
    }
    listed += __popc(touch);
  }
  if (listed % 2 != 0 && lane == 0) list[listed] = kSlots;
  __syncwarp();
  return (listed + 1) / 2;
}

/// Calls f(number of a splat, what it is, its reach) for those that the warp listed, as long as
/// `more()` says so to all of its lanes, which is asked now and then. The second one's reach is
/// found while the first one's use waits.
template <int kSlots, bool kKeep, typename More, typename F>
__device__ void for_each_listed(const DrawShared<kSlots, kKeep>& shared, int words,
                                const Place& place, More&& more, F&& f) {
  constexpr int kAtOnce = 8;
  const auto* const pairs = shared.pairs[threadIdx.x / kWarp];
  for (int base = 0; base < words; base += kAtOnce) {
    if (!more()) return;
    const int end = min(base + kAtOnce, words);
    for (int k = base; k < end; ++k) {
      const auto first = static_cast<int>(pairs[k] & 0xffffU);
      const auto second = static_cast<int>(pairs[k] >> 16U);
      const Drawable a = shared.batch.get(first);
      const Drawable b = shared.batch.get(second);
      const Reach reach_a = reach_of(a, place);
      const Reach reach_b = reach_of(b, place);
      f(first, a, reach_a);
      f(second, b, reach_b);
    }
  }
}

/// What a word of thread 0's is, for all threads.
__device__ std::uint32_t from_first(std::uint32_t word, std::uint32_t& shared) {
  __syncthreads();
  if (threadIdx.x == 0) shared = word;
  __syncthreads();
  return shared;
}

__device__ std::uint32_t look(const std::uint32_t* at) {
  return *static_cast<const volatile std::uint32_t*>(at);
}

/// What a chunk lets through is there for those behind it.
__device__ void say_through(const Chunk& chunk, const BinPointers& bins,
                            const ChunkPointers& chunks, const float (&light)[kPixels]) {
  chunks.through[chunk.id * kThreads + threadIdx.x] =
      make_float2(fmaxf(light[0], 0.0f), fmaxf(light[1], 0.0f));
  __threadfence();
  __syncthreads();
  if (threadIdx.x == 0) *static_cast<volatile std::uint32_t*>(bins.drawing.ready + chunk.id) = 1;
}

/// How much light a chunk lets through, alone. Where it is less than a pixel is drawn for, it does
/// not matter how much.
template <int kSlots, bool kKeep>
__device__ void dim(const DrawShared<kSlots, kKeep>& shared, int words, const Place& place,
                    float (&light)[kPixels]) {
  constexpr auto kLeast = static_cast<float>(kMinTransmittance);
  const auto more = [&] {
    return __any_sync(kAllLanes, light[0] > kLeast || light[1] > kLeast) != 0;
  };
  for_each_listed(shared, words, place, more, [&](int, const Drawable&, const Reach& reach) {
#pragma unroll
    for (int p = 0; p < kPixels; ++p) {
      const float alpha = fminf(reach.uncut[p], static_cast<float>(kMaxAlpha));
      const float next = __fmaf_rn(-light[p], alpha, light[p]);
      light[p] = reach.touched[p] ? next : light[p];
    }
  });
  for (float& x : light) x = x > kLeast ? x : 0.0f;
}

/// Light that a chunk starts with; negative: finished before, or no pixel of the image. Waits for
/// the chunks before it.
__device__ void find_start(const Chunk& chunk, const BinPointers& bins, const ChunkPointers& chunks,
                           float (&light)[kPixels]) {
  for (std::uint32_t k = chunk.first + threadIdx.x; k < chunk.id; k += kThreads) {
    while (look(bins.drawing.ready + k) == 0) {
    }
  }
  __threadfence();
  __syncthreads();
#pragma unroll 8
  for (std::uint32_t k = chunk.first; k < chunk.id; ++k) {
    const float2 through = __ldcg(chunks.through + k * kThreads + threadIdx.x);
    light[0] *= through.x;
    light[1] *= through.y;
  }
  for (float& x : light) {
    if (x <= static_cast<float>(kMinTransmittance)) x = -1.0f;
  }
}

/// Draws the splats of a chunk; `weights` become the largest of each, `blocks` those that have it.
template <int kSlots, bool kKeep>
__device__ void blend(DrawShared<kSlots, kKeep>& shared, int words, const Place& place,
                      float (&light)[kPixels], float (&sum)[kPixels][4]) {
  const auto more = [&] { return __any_sync(kAllLanes, any_live(light)) != 0; };
  const auto draw = [&](int at, const Drawable& s, const Reach& reach) {
    int best = 0;
#pragma unroll
    for (int p = 0; p < kPixels; ++p) {
      const Share share = pass(reach, p, light[p]);
      sum[p][0] = fmaf(share.weight, s.red, sum[p][0]);
      sum[p][1] = fmaf(share.weight, s.green, sum[p][1]);
      sum[p][2] = fmaf(share.weight, s.blue, sum[p][2]);
      sum[p][3] = fmaf(share.weight, s.z, sum[p][3]);
      best = max(best, share.finished ? kFinishedOnly : __float_as_int(share.weight));
    }
    if constexpr (kKeep) {
      best = __reduce_max_sync(kAllLanes, best);
      if (threadIdx.x % kWarp == 0 && best != 0) {
        atomicMax(shared.seen.weights + at, best);
        atomicOr(shared.seen.blocks + at, 1U << (threadIdx.x / kWarp));
      }
    }
  };
  for_each_listed(shared, words, place, more, draw);
}

/// The largest weights of a chunk's slots and of the Gaussians they are of. What was drawn the walk
/// back finds in a row where the chunk's slots were.
template <int kSlots>
__device__ void store_weights(DrawShared<kSlots, true>& shared, const Chunk& chunk,
                              const SplatPointers& splats, const BinPointers& bins,
                              float* slot_weight, float* max_weight) {
  const int warp = static_cast<int>(threadIdx.x) / kWarp;
  const unsigned below = (1U << threadIdx.x % kWarp) - 1;
  std::uint32_t before = chunk.begin;
  for (int base = 0; base < chunk.size(); base += kThreads) {
    const int at = base + static_cast<int>(threadIdx.x);
    const int weight = at < chunk.size() ? shared.seen.weights[at] : 0;
    const unsigned drawn = __ballot_sync(kAllLanes, weight != 0);
    if (threadIdx.x % kWarp == 0) shared.seen.found[warp] = __popc(drawn);
    __syncthreads();
    std::uint32_t to = before + __popc(drawn & below);
    for (int w = 0; w < kTileWarps; ++w) {
      if (w < warp) to += shared.seen.found[w];
      before += shared.seen.found[w];
    }
    const std::uint32_t slot = at < chunk.size() ? shared.batch.splats[at].slot : 0;
    if (at < chunk.size()) slot_weight[slot] = __int_as_float(weight);
    if (weight != 0) {
      const std::uint32_t splat = bins.slot_splat[slot];
      bins.tile_slots[to] = slot;
      bins.tile_draws[to] = shared.seen.blocks[at] << kSplatBits | splat;
      auto* const best = reinterpret_cast<int*>(max_weight + splats.gaussian[splat]);
      if (weight != kFinishedOnly) atomicMax(best, weight);
    }
    __syncthreads();
  }
  if (threadIdx.x == 0) bins.chunk_drawn[chunk.id] = before - chunk.begin;
}

__device__ void store_image(const Place& place, const Frame& frame, const ImagePointers& image,
                            const float (&through)[kPixels], const float (&sum)[kPixels][4]) {
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

/// What a chunk left of a thread's pixels.
struct Part {
  float2 end;
  float4 sums[kPixels];
};

/// Adds up what the chunks of a tile have, and leaves each with the sums of those before it, where
/// that is wanted.
template <bool kKeep>
__device__ void join(const Chunk& chunk, const Place& place, const Frame& frame,
                     const BinPointers& bins, const ChunkPointers& chunks,
                     const ImagePointers& image) {
  constexpr std::uint32_t kAtOnce = 2;
  float through[kPixels] = {1.0f, 1.0f};
  float sum[kPixels][4] = {};
  const std::uint32_t last = min(chunk.last, look(bins.dark + chunk.tile));
  for (std::uint32_t k = chunk.first; k <= last; k += kAtOnce) {
    Part parts[kAtOnce] = {};
#pragma unroll
    for (std::uint32_t j = 0; j < kAtOnce; ++j) {
      if (k + j > last) continue;
      const std::uint32_t at = (k + j) * kThreads + threadIdx.x;
      parts[j].end = __ldcg(chunks.end + at);
      for (int p = 0; p < kPixels; ++p) {
        parts[j].sums[p] = __ldcg(chunks.sums + kPixels * at + p);
      }
    }
#pragma unroll
    for (std::uint32_t j = 0; j < kAtOnce; ++j) {
      if (k + j > last) continue;
      const std::uint32_t at = (k + j) * kThreads + threadIdx.x;
      if (parts[j].end.x != 0.0f) through[0] = fabsf(parts[j].end.x);
      if (parts[j].end.y != 0.0f) through[1] = fabsf(parts[j].end.y);
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
  store_image(place, frame, image, through, sum);
}

/// Whether all other chunks of the tile were drawn before this one.
__device__ bool is_last_drawn(const Chunk& chunk, const BinPointers& bins, std::uint32_t& shared) {
  __threadfence();
  __syncthreads();
  std::uint32_t before = 0;
  if (threadIdx.x == 0) before = atomicAdd(bins.drawing.drawn + chunk.tile, 1U);
  const bool out = from_first(before, shared) == chunk.last - chunk.first;
  __threadfence();
  return out;
}

template <int kSlots, bool kKeep>
__global__ void __launch_bounds__(kThreads, kDrawBlocks)
    draw_kernel(Frame frame, SplatPointers splats, BinPointers bins, ImagePointers image,
                ChunkPointers chunks, float* slot_weight, float* max_weight) {
  __shared__ DrawShared<kSlots, kKeep> shared;
  std::uint32_t turn = 0;
  if (threadIdx.x == 0) turn = atomicAdd(bins.drawing.begun, 1U);
  const Chunk chunk(frame, bins, splats.slot_capacity, from_first(turn, shared.word));
  if (chunk.none) return;
  const Corner tile = chunk.corner(frame);
  const Place place(tile);
  const bool first = chunk.id == chunk.first;
  const bool last = chunk.id == chunk.last;
  const int count = chunk.size();
  const std::uint32_t to = chunk.id * kThreads + threadIdx.x;
  float light[kPixels];
  float sum[kPixels][4] = {};
  for (int p = 0; p < kPixels; ++p) light[p] = place.inside(frame, p) ? 1.0f : -1.0f;
  const bool behind = from_first(look(bins.dark + chunk.tile), shared.word) < chunk.id;
  if (behind) {
    if (!last) say_through(chunk, bins, chunks, {0.0f, 0.0f});
    if constexpr (kKeep) {
      for (auto at = static_cast<int>(threadIdx.x); at < count; at += kThreads) {
        slot_weight[bins.tile_slots[chunk.begin + at]] = 0.0f;
      }
    }
  } else {
    fetch(chunk, frame, splats, bins, shared);
    __syncthreads();
    const int words = list_touching(shared, count);
    if (!first && !last) {
      float through[kPixels] = {light[0], light[1]};
      dim(shared, words, place, through);
      say_through(chunk, bins, chunks, through);
    }
    if (!first) find_start(chunk, bins, chunks, light);
    if (kKeep && !first) chunks.start[to] = make_float2(light[0], light[1]);
    const bool live_before[kPixels] = {light[0] > 0.0f, light[1] > 0.0f};
    const bool lit = __syncthreads_or(any_live(light)) != 0;
    blend(shared, words, place, light, sum);
    if (first && !last) say_through(chunk, bins, chunks, light);
    if (__syncthreads_or(any_live(light)) == 0 && lit && threadIdx.x == 0) {
      atomicMin(bins.dark + chunk.tile, chunk.id);
    }
    if constexpr (kKeep) store_weights(shared, chunk, splats, bins, slot_weight, max_weight);
    if (first && last) {
      for (float& x : light) x = fabsf(x);
      return store_image(place, frame, image, light, sum);
    }
    chunks.end[to] =
        make_float2(live_before[0] ? light[0] : 0.0f, live_before[1] ? light[1] : 0.0f);
    for (int p = 0; p < kPixels; ++p) {
      chunks.sums[kPixels * to + p] = make_float4(sum[p][0], sum[p][1], sum[p][2], sum[p][3]);
    }
  }
  if (!is_last_drawn(chunk, bins, shared.word)) return;
  join<kKeep>(chunk, place, frame, bins, chunks, image);
}

}  // namespace

cudaError_t launch_blend(const Frame& frame, const SplatPointers& splats, const BinPointers& bins,
                         const ImagePointers& image, const ChunkPointers& chunks,
                         float* slot_weight, const StatisticsPointers& statistics,
                         cudaStream_t stream) {
  const unsigned blocks = chunk_capacity(splats.slot_capacity, bins.chunk_slots, frame.tiles());
  const bool keep = slot_weight != nullptr;
  auto kernel = keep ? draw_kernel<kMostChunkSlots, true> : draw_kernel<kMostChunkSlots, false>;
  if (bins.chunk_slots == kLeastChunkSlots) {
    kernel = keep ? draw_kernel<kLeastChunkSlots, true> : draw_kernel<kLeastChunkSlots, false>;
  }
  kernel<<<blocks, kThreads, 0, stream>>>(frame, splats, bins, image, chunks, slot_weight,
                                          statistics.max_weight);
  return cudaGetLastError();
}

}  // namespace apvi::splat::cuda
