// SPDX-License-Identifier: BSD-3-Clause
// Which splats each tile draws, in which order: splats are sorted by depth, their slots listed in
// that order, and these sorted by tile, which keeps the order within each. Two sorts of short keys
// move fewer bytes than one of long keys (Schütz et al.; Feng et al., "FlashGS", 2024).
#include <thrust/iterator/counting_iterator.h>
#include <thrust/iterator/transform_iterator.h>

#include <cub/block/block_scan.cuh>
#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_scan.cuh>

#include <algorithm>

#include "gaussian_rows.cuh"

namespace apvi::splat::cuda {
namespace {

constexpr int kThreads = 256;

/// How many slots the splat of a rank has.
struct SlotCount {
  const std::uint32_t* order;
  const SlotRange* slots;
  std::uint32_t capacity;

  __device__ std::uint32_t operator()(std::uint32_t rank) const {
    const std::uint32_t splat = order[rank];
    return splat < capacity ? slots[splat].count : 0;
  }
};
using SlotCounts = thrust::transform_iterator<SlotCount, thrust::counting_iterator<std::uint32_t>>;

/// Parts of the scratch memory. Key: what holds the number of a tile, and one more.
template <typename Key>
struct Parts {
  std::uint32_t* depth_keys;  // [capacity] sorted; nobody reads them
  std::uint32_t* order;       // [capacity] splats by depth
  std::uint32_t* offsets;     // [capacity] where the slots of each begin in that order
  Key* keys;                  // [slot_capacity] tiles of the slots in that order
  Key* sorted_keys;           // [slot_capacity]
  std::uint32_t* slots;       // [slot_capacity] in that order
  void* cub;
  std::size_t cub_bytes;
};

int bits_for(int tiles) {
  int bits = 1;
  while (1 << bits <= tiles) ++bits;
  return bits;
}

SlotCounts slot_counts(const std::uint32_t* order, const SplatPointers& splats) {
  return {thrust::counting_iterator<std::uint32_t>(0), {order, splats.slots, splats.capacity}};
}

cudaError_t sort_by_depth(void* cub, std::size_t& bytes, const SplatPointers& splats,
                          std::uint32_t* keys, std::uint32_t* order, cudaStream_t stream) {
  return cub::DeviceRadixSort::SortPairs(cub, bytes, splats.depth_keys, keys, splats.order, order,
                                         static_cast<int>(splats.capacity), 0, 32, stream);
}

template <typename Key>
cudaError_t sort_by_tile(const Parts<Key>& parts, std::size_t& bytes, std::uint32_t* out,
                         std::uint32_t slot_capacity, int tiles, cudaStream_t stream) {
  return cub::DeviceRadixSort::SortPairs(parts.cub, bytes, parts.keys, parts.sorted_keys,
                                         parts.slots, out, static_cast<int>(slot_capacity), 0,
                                         bits_for(tiles), stream);
}

template <typename Key>
std::size_t cub_bytes(std::uint32_t capacity, std::uint32_t slot_capacity, int tiles) {
  SplatPointers splats = {};
  splats.capacity = capacity;
  std::size_t sort = 0;
  std::size_t scan = 0;
  std::size_t tile_sort = 0;
  sort_by_depth(nullptr, sort, splats, nullptr, nullptr, nullptr);
  cub::DeviceScan::ExclusiveSum(nullptr, scan, slot_counts(nullptr, splats),
                                static_cast<std::uint32_t*>(nullptr), static_cast<int>(capacity));
  sort_by_tile(Parts<Key>{}, tile_sort, nullptr, slot_capacity, tiles, nullptr);
  return std::max({sort, scan, tile_sort});
}

/// Cuts the scratch memory into its parts; null for a start gives offsets, the last one the size.
template <typename Key>
Parts<Key> cut(void* start, std::uint32_t capacity, std::uint32_t slot_capacity, int tiles,
               std::size_t* total) {
  constexpr std::size_t kAlign = 256;
  std::size_t used = 0;
  const auto take = [&](std::size_t bytes) {
    void* const at = static_cast<char*>(start) + used;
    used += (bytes + kAlign - 1) / kAlign * kAlign;
    return at;
  };
  Parts<Key> out = {};
  const auto take_ids = [&](std::uint32_t count) {
    return static_cast<std::uint32_t*>(take(count * sizeof(std::uint32_t)));
  };
  out.depth_keys = take_ids(capacity);
  out.order = take_ids(capacity);
  out.offsets = take_ids(capacity);
  out.keys = static_cast<Key*>(take(slot_capacity * sizeof(Key)));
  out.sorted_keys = static_cast<Key*>(take(slot_capacity * sizeof(Key)));
  out.slots = take_ids(slot_capacity);
  out.cub_bytes = cub_bytes<Key>(capacity, slot_capacity, tiles);
  out.cub = take(out.cub_bytes);
  if (total != nullptr) *total = used;
  return out;
}

/// Writes the slots of one splat in one band of tiles; returns how many.
template <typename Key>
__device__ int list_band(const Splat<float>& s, PixelSpan rows, int band, const Frame& frame,
                         std::uint32_t to, std::uint32_t slot, std::uint32_t capacity,
                         const Parts<Key>& out) {
  const PixelSpan columns = tiles_in_band(s, rows, band, frame.width);
  int count = 0;
  for (int x = columns.first; x <= columns.last; ++x, ++count) {
    if (to + count >= capacity || slot + count >= capacity) continue;
    out.keys[to + count] = static_cast<Key>(band * frame.tiles_x() + x);
    out.slots[to + count] = slot + count;
  }
  return count;
}

/// The same for all bands, by a whole warp: splats near the camera cover the image.
template <typename Key>
__device__ void list_by_warp(const Splat<float>& s, const Frame& frame, std::uint32_t to,
                             std::uint32_t slot, std::uint32_t capacity, const Parts<Key>& out) {
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  const PixelSpan rows = rows_of(s, frame.height);
  const int last = rows.last / kTileSize;
  for (int first = rows.first / kTileSize; first <= last; first += kWarp) {
    const int band = first + lane;
    PixelSpan columns = {0, -1};
    if (band <= last) columns = tiles_in_band(s, rows, band, frame.width);
    const int own = columns.last - columns.first + 1;
    int before = own;  // becomes the sum over the lanes up to this one
    for (int by = 1; by < kWarp; by *= 2) {
      const int other = __shfl_up_sync(kAllLanes, before, by);
      if (lane >= by) before += other;
    }
    const int all = __shfl_sync(kAllLanes, before, kWarp - 1);
    before -= own;
    if (band <= last) list_band(s, rows, band, frame, to + before, slot + before, capacity, out);
    to += all;
    slot += all;
  }
}

constexpr std::uint32_t kManySlots = 24;

template <typename Key>
__global__ void list_kernel(Frame frame, SplatPointers splats, Parts<Key> out,
                            std::uint32_t* slot_splat) {
  const std::uint32_t rank = blockIdx.x * kThreads + threadIdx.x;
  const std::uint32_t splat = rank < splats.capacity ? out.order[rank] : ~0U;
  SlotRange slots = {0, 0};
  std::uint32_t to = 0;
  if (splat < splats.capacity) {
    slots = splats.slots[splat];
    to = out.offsets[rank];
  }
  if (slots.count != 0 && slots.count <= kManySlots) {
    const Splat<float> s = splats.splats[splat];
    const PixelSpan rows = rows_of(s, frame.height);
    std::uint32_t done = 0;
    for (int band = rows.first / kTileSize; band * kTileSize <= rows.last; ++band) {
      done +=
          list_band(s, rows, band, frame, to + done, slots.begin + done, splats.slot_capacity, out);
    }
    for (std::uint32_t k = 0; k < slots.count && slots.begin + k < splats.slot_capacity; ++k) {
      slot_splat[slots.begin + k] = splat;
    }
  }
  for (unsigned left = __ballot_sync(kAllLanes, slots.count > kManySlots); left != 0;
       left &= left - 1) {
    const int from = __ffs(static_cast<int>(left)) - 1;
    const std::uint32_t its = __shfl_sync(kAllLanes, splat, from);
    const std::uint32_t begin = __shfl_sync(kAllLanes, slots.begin, from);
    const std::uint32_t count = __shfl_sync(kAllLanes, slots.count, from);
    list_by_warp(splats.splats[its], frame, __shfl_sync(kAllLanes, to, from), begin,
                 splats.slot_capacity, out);
    for (std::uint32_t k = threadIdx.x % kWarp; k < count; k += kWarp) {
      if (begin + k < splats.slot_capacity) slot_splat[begin + k] = its;
    }
  }
}

/// Where each tile begins. A key beyond the last tile marks memory that holds no slot.
template <typename Key>
__global__ void find_tiles_kernel(const Key* keys, std::uint32_t capacity, int tiles,
                                  std::uint32_t* tile_begin) {
  const std::uint32_t k = blockIdx.x * kThreads + threadIdx.x;
  if (k > capacity) return;
  const auto tile_at = [&](std::uint32_t at) {
    return static_cast<int>(min(std::uint32_t{keys[at]}, static_cast<std::uint32_t>(tiles)));
  };
  const int before = k == 0 ? -1 : tile_at(k - 1);
  const int here = k == capacity ? tiles : tile_at(k);
  for (int tile = before + 1; tile <= here; ++tile) tile_begin[tile] = k;
}

constexpr int kChunkThreads = 1024;

/// One block: the chunks of all tiles, in the order of the tiles.
__global__ void __launch_bounds__(kChunkThreads)
    find_chunks_kernel(int tiles, BinPointers bins, std::uint32_t capacity) {
  using Scan = cub::BlockScan<std::uint32_t, kChunkThreads>;
  __shared__ typename Scan::TempStorage storage;
  std::uint32_t before = 0;
  for (int first = 0; first < tiles; first += kChunkThreads) {
    const int tile = first + static_cast<int>(threadIdx.x);
    std::uint32_t own = 0;
    if (tile < tiles) {
      const std::uint32_t slots = bins.tile_begin[tile + 1] - bins.tile_begin[tile];
      own = (slots + bins.chunk_slots - 1) / bins.chunk_slots;
    }
    std::uint32_t at = 0;
    std::uint32_t all = 0;
    Scan(storage).ExclusiveSum(own, at, all);
    __syncthreads();  // the storage is used again
    if (tile < tiles) bins.chunk_begin[tile] = before + at;
    for (std::uint32_t k = before + at; k < min(before + at + own, capacity); ++k) {
      bins.chunk_tile[k] = static_cast<std::uint32_t>(tile);
    }
    before += all;
  }
  if (threadIdx.x == 0) bins.chunk_begin[tiles] = min(before, capacity);
}

unsigned blocks_for(std::uint64_t count) {
  return static_cast<unsigned>((count + kThreads - 1) / kThreads);
}

template <typename Key>
cudaError_t bin(const Frame& frame, const SplatPointers& splats, const BinPointers& out,
                cudaStream_t stream) {
  Parts<Key> parts =
      cut<Key>(out.scratch, splats.capacity, splats.slot_capacity, frame.tiles(), nullptr);
  cudaError_t error =
      sort_by_depth(parts.cub, parts.cub_bytes, splats, parts.depth_keys, parts.order, stream);
  if (error != cudaSuccess) return error;
  error =
      cub::DeviceScan::ExclusiveSum(parts.cub, parts.cub_bytes, slot_counts(parts.order, splats),
                                    parts.offsets, static_cast<int>(splats.capacity), stream);
  if (error != cudaSuccess) return error;
  error = cudaMemsetAsync(parts.keys, 0xff, splats.slot_capacity * sizeof(Key), stream);
  if (error != cudaSuccess) return error;
  list_kernel<<<blocks_for(splats.capacity), kThreads, 0, stream>>>(frame, splats, parts,
                                                                    out.slot_splat);
  error = sort_by_tile(parts, parts.cub_bytes, out.tile_slots, splats.slot_capacity, frame.tiles(),
                       stream);
  if (error != cudaSuccess) return error;
  find_tiles_kernel<<<blocks_for(std::uint64_t{splats.slot_capacity} + 1), kThreads, 0, stream>>>(
      parts.sorted_keys, splats.slot_capacity, frame.tiles(), out.tile_begin);
  find_chunks_kernel<<<1, kChunkThreads, 0, stream>>>(
      frame.tiles(), out, chunk_capacity(splats.slot_capacity, out.chunk_slots, frame.tiles()));
  return cudaGetLastError();
}

constexpr int kShortKeys = 0xffff;

}  // namespace

std::uint32_t chunk_slots(std::uint32_t slot_capacity) {
  constexpr std::uint32_t kBlocks = 4096;  // twice what a large device runs at once
  std::uint32_t slots = kLeastChunkSlots;
  while (slots < kMostChunkSlots && 2 * slots * kBlocks <= slot_capacity) slots *= 2;
  return slots;
}

std::uint32_t chunk_capacity(std::uint32_t slot_capacity, std::uint32_t chunk_slots, int tiles) {
  return slot_capacity / chunk_slots + static_cast<std::uint32_t>(tiles);
}

std::size_t bin_scratch_bytes(std::uint32_t capacity, std::uint32_t slot_capacity, int tiles) {
  std::size_t bytes = 0;
  if (tiles < kShortKeys) {
    cut<std::uint16_t>(nullptr, capacity, slot_capacity, tiles, &bytes);
  } else {
    cut<std::uint32_t>(nullptr, capacity, slot_capacity, tiles, &bytes);
  }
  return bytes;
}

cudaError_t launch_bin(const Frame& frame, const SplatPointers& splats, const BinPointers& out,
                       cudaStream_t stream) {
  return frame.tiles() < kShortKeys ? bin<std::uint16_t>(frame, splats, out, stream)
                                    : bin<std::uint32_t>(frame, splats, out, stream);
}

}  // namespace apvi::splat::cuda
