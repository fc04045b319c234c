// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cub/block/block_scan.cuh>

#include "kernels/raster/look_back.cuh"
#include "kernels/raster/radix_sort.cuh"

/// Slots per tile and what follows: their offsets, the launch order of the tiles' chunks, and the
/// digit offsets for sorting the slots by tile. Computed before the sort, so that it need not
/// count, and concurrently with it for the chunks.
namespace apvi::gaussians::cuda {

inline constexpr int kTileBits = 6;  // per digit

struct TileState {
  std::uint32_t* slots;     // [tiles] slot count
  std::uint32_t* finished;  // [1] finished blocks of the count
};

inline constexpr int kCountThreads = 1024;
// Launch order of chunks by kind: full chunks by their position in the tile, one kind each for the
// first four, then doubling; then chunks at least half full; then the rest.
inline constexpr int kHalfFull = kChunkKinds - 2;

/// Calls f(kind, index of the first chunk in its tile, count) for the chunks of a tile.
template <typename F>
__device__ inline void for_each_kind(std::uint32_t slots, std::uint32_t chunk_slots,
                                     std::uint32_t chunks, F&& f) {
  const std::uint32_t full = slots / chunk_slots;
  int kind = 0;
  for (std::uint32_t first = 0; first < full; ++kind) {
    const std::uint32_t last = kind < 4 ? first + 1 : 2 * first;
    const std::uint32_t end = kind + 1 < kHalfFull ? min(last, full) : full;
    f(kind, first, end - first);
    first = end;
  }
  if (full == chunks) return;
  f((slots - full * chunk_slots) * 2 >= chunk_slots ? kHalfFull : kHalfFull + 1, full, 1U);
}

inline constexpr int kMaxSharedTiles = 8192;  // maximum number of tiles counted in shared memory

template <typename Key>
__device__ inline void count_slots(const Key* keys, std::uint32_t n, std::uint32_t* counts) {
  constexpr std::uint32_t kAtOnce = 4;
  const std::uint32_t stride = gridDim.x * kCountThreads;
  for (std::uint32_t i = blockIdx.x * kCountThreads + threadIdx.x; i < n; i += kAtOnce * stride) {
    Key own[kAtOnce];
#pragma unroll
    for (std::uint32_t k = 0; k < kAtOnce; ++k) {
      if (i + k * stride < n) own[k] = keys[i + k * stride];
    }
#pragma unroll
    for (std::uint32_t k = 0; k < kAtOnce; ++k) {
      if (i + k * stride < n) atomicAdd(counts + own[k], 1U);
    }
  }
}

/// One block: from the slot counts, computes the first slot and chunk of each tile, the position of
/// each kind of chunks in the launch order, and the digit offsets for sorting by tile.
__device__ inline void place_tiles(int tiles, int passes, const BinPointers& bins,
                                   const std::uint32_t* slot_counts, std::uint32_t* digit_counts) {
  constexpr int kDigits = 1 << kTileBits;
  using Scan = cub::BlockScan<Packed, kCountThreads>;
  __shared__ typename Scan::TempStorage storage;
  __shared__ std::uint32_t kinds[kChunkKinds];
  __shared__ std::uint32_t digits[kMaxPasses * kDigits];
  if (threadIdx.x < kChunkKinds) kinds[threadIdx.x] = 0;
  if (threadIdx.x < kMaxPasses * kDigits) digits[threadIdx.x] = 0;
  Packed before = 0;
  for (int first = 0; first < tiles; first += kCountThreads) {
    const int tile = first + static_cast<int>(threadIdx.x);
    const std::uint32_t slots = tile < tiles ? __ldcg(slot_counts + tile) : 0;
    const std::uint32_t own =
        tile < tiles ? max(1U, (slots + bins.chunk_slots - 1) / bins.chunk_slots) : 0;
    Packed at = 0;
    Packed all = 0;
    Scan(storage).ExclusiveSum(pack(own, slots), at, all);
    __syncthreads();  // the storage is reused
    if (tile < tiles) {
      bins.tile_begin[tile] = slots_in(before + at);
      bins.chunk_begin[tile] = splats_in(before + at);
      for_each_kind(slots, bins.chunk_slots, own,
                    [&](int kind, std::uint32_t, std::uint32_t n) { atomicAdd(kinds + kind, n); });
      for (int pass = 0; pass < passes; ++pass) {
        const std::uint32_t digit = digit_of<kTileBits>(static_cast<std::uint32_t>(tile), pass);
        if (slots != 0) atomicAdd(digits + pass * kDigits + digit, slots);
      }
    }
    before += all;
  }
  __syncthreads();
  if (static_cast<int>(threadIdx.x) < passes * kDigits) {
    digit_counts[threadIdx.x] = digits[threadIdx.x];
  }
  __syncthreads();
  const int pass = static_cast<int>(threadIdx.x) / kWarp;
  if (pass < passes) sum_counts<kTileBits>(digit_counts + pass * kDigits);
  if (threadIdx.x != kCountThreads - 1) return;
  bins.tile_begin[tiles] = slots_in(before);
  bins.chunk_begin[tiles] = splats_in(before);
  *bins.drawing.started = 0;
  std::uint32_t at = 0;
  for (int kind = 0; kind < kChunkKinds; ++kind) {
    bins.drawing.kinds[kind] = at;
    at += kinds[kind];
  }
}

/// Counts the slots of each tile; the last block to finish computes the offsets.
template <typename Key, typename Count>
__global__ void __launch_bounds__(kCountThreads)
    count_tiles_kernel(const Key* keys, Count count, int tiles, int passes, BinPointers bins,
                       TileState state, std::uint32_t* digit_counts) {
  __shared__ std::uint32_t local[kMaxSharedTiles];
  __shared__ bool last;
  if (tiles <= kMaxSharedTiles) {
    for (auto k = static_cast<int>(threadIdx.x); k < tiles; k += kCountThreads) local[k] = 0;
    __syncthreads();
    count_slots(keys, count(), local);
    __syncthreads();
    for (auto k = static_cast<int>(threadIdx.x); k < tiles; k += kCountThreads) {
      if (local[k] != 0) atomicAdd(state.slots + k, local[k]);
    }
  } else {
    count_slots(keys, count(), state.slots);
  }
  __threadfence();
  __syncthreads();
  if (threadIdx.x == 0) last = atomicAdd(state.finished, 1U) == gridDim.x - 1;
  __syncthreads();
  if (!last) return;
  __threadfence();
  place_tiles(tiles, passes, bins, state.slots, digit_counts);
}

}  // namespace apvi::gaussians::cuda
