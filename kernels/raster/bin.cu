// SPDX-License-Identifier: BSD-3-Clause
// Binning: sorts the splats by depth, lists their slots in that order, and stably sorts these by
// tile. Two sorts of short keys move fewer bytes than one of long keys (Schütz et al.; Feng et al.,
// "FlashGS", 2024).
#include <cub/block/block_scan.cuh>

#include <utility>

#include "kernels/raster/look_back.cuh"
#include "kernels/raster/radix_sort.cuh"
#include "kernels/raster/tile_count.cuh"

namespace apvi::gaussians::cuda {
namespace {

constexpr int kThreads = 256;

struct SplatCount {
  const Counts* counts;
  std::uint32_t capacity;

  __device__ std::uint32_t operator()() const { return min(counts->splats, capacity); }
};
/// Number of slots to list; zero when a capacity is exceeded.
struct SlotCount {
  const Counts* counts;
  std::uint32_t capacity, slot_capacity;

  __device__ std::uint32_t operator()() const {
    return counts->splats <= capacity && counts->slots <= slot_capacity ? counts->slots : 0;
  }
};

/// Digits of a tile index.
int tile_passes(int tiles) {
  int passes = 1;
  while (tiles - 1 >> passes * kTileBits != 0) ++passes;
  return passes;
}

/// Bump allocator with 256 byte alignment; with a null start it only measures.
class Arena {
 public:
  explicit Arena(void* start) : start_(static_cast<char*>(start)) {}

  template <typename T>
  T* take(std::size_t count) {
    constexpr std::size_t kAlign = 256;
    auto* const at = reinterpret_cast<T*>(start_ + used_);
    used_ += (count * sizeof(T) + kAlign - 1) / kAlign * kAlign;
    return at;
  }
  std::size_t used() const { return used_; }

 private:
  char* start_;
  std::size_t used_ = 0;
};

unsigned blocks_for(std::uint64_t count) {
  return static_cast<unsigned>((count + kThreads - 1) / kThreads);
}

/// Zero-initialized state.
struct State {
  Packed* list;  // [blocks of the listing + 1]
  TileState tiles;
  SortState by_depth, by_tile;
  std::size_t bytes;

  State(void* start, std::uint32_t capacity, std::uint32_t slot_capacity, const Frame& frame) {
    Arena arena(start);
    const int by_depths = depth_passes(frame.camera.near_m);
    const int passes = tile_passes(frame.tiles());
    list = arena.take<Packed>(blocks_for(capacity) + 1);
    const auto tile_count = static_cast<std::size_t>(frame.tiles());
    tiles.slots = arena.take<std::uint32_t>(tile_count + 1);
    tiles.finished = tiles.slots + tile_count;
    by_depth = cut_sort_state<kDepthBits>(
        arena.take<std::uint32_t>(sort_state_words<kDepthBits>(capacity, by_depths)), by_depths);
    by_tile = cut_sort_state<kTileBits>(
        arena.take<std::uint32_t>(sort_state_words<kTileBits>(slot_capacity, passes)), passes);
    bytes = arena.used();
  }
};

/// Uninitialized scratch. Key: type of a tile index.
template <typename Key>
struct Scratch {
  std::uint32_t* depth_keys;  // [capacity]
  std::uint32_t* orders[2];   // [capacity] one of them becomes the splats by depth
  Key* keys[2];               // [slot_capacity] tiles of the slots
  std::uint32_t* slots;       // [slot_capacity]
  std::size_t bytes;

  Scratch(void* start, std::uint32_t capacity, std::uint32_t slot_capacity) {
    Arena arena(start);
    depth_keys = arena.take<std::uint32_t>(capacity);
    for (auto& order : orders) order = arena.take<std::uint32_t>(capacity);
    for (auto& key : keys) key = arena.take<Key>(slot_capacity);
    slots = arena.take<std::uint32_t>(slot_capacity);
    bytes = arena.used();
  }
};

/// The slots sorted by the depth of their splats.
template <typename Key>
struct List {
  Key* tiles;
  std::uint32_t* splats;
};

/// Writes the slots of one splat in one row of tiles.
template <typename Key>
__device__ void list_tile_row(PixelSpan columns, std::uint32_t splat, int tile_row,
                              const Frame& frame, std::uint32_t to, const List<Key>& out) {
  for (int x = columns.first; x <= columns.last; ++x, ++to) {
    out.tiles[to] = static_cast<Key>(tile_row * frame.tiles_x() + x);
    out.splats[to] = splat;
  }
}

/// The same for all rows of tiles, by a whole warp: splats near the camera cover the image.
template <typename Key>
__device__ void list_by_warp(const SplatPointers& splats, std::uint32_t splat, const Frame& frame,
                             std::uint32_t to, const List<Key>& out) {
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  const Splat<float> s = splats.splats[splat];
  const PixelSpan rows = row_span(s, frame.height);
  const int last = rows.last / kTileSize;
  for (int first = rows.first / kTileSize; first <= last; first += kWarp) {
    const int tile_row = first + lane;
    PixelSpan columns = {0, -1};
    if (tile_row <= last) columns = tile_column_span(s, rows, tile_row, frame.width);
    const int own = columns.last - columns.first + 1;
    int before = own;  // becomes the inclusive sum over the lanes
    for (int by = 1; by < kWarp; by *= 2) {
      const int other = __shfl_up_sync(kAllLanes, before, by);
      if (lane >= by) before += other;
    }
    const int all = __shfl_sync(kAllLanes, before, kWarp - 1);
    list_tile_row(columns, splat, tile_row, frame, to + before - own, out);
    to += all;
  }
}

/// Writes the slots of the splats of a warp, each from its offset on.
template <typename Key>
__device__ void list_splats(const Frame& frame, const SplatPointers& splats, std::uint32_t splat,
                            const SlotRange& packed, std::uint32_t to, const List<Key>& out) {
  const bool has_mask = (packed.begin & kTileMaskFlag) != 0;
  if (has_mask) {
    const TileMask tiles = TileMask::unpack(packed);
    const int corner = tiles.y * frame.tiles_x() + tiles.x;
    std::uint32_t at = to;
    for (unsigned left = tiles.mask; left != 0; left &= left - 1, ++at) {
      const int bit = __ffs(static_cast<int>(left)) - 1;
      out.tiles[at] =
          static_cast<Key>(corner + bit / kTileMaskSide * frame.tiles_x() + bit % kTileMaskSide);
      out.splats[at] = splat;
    }
  }
  for (unsigned left = __ballot_sync(kAllLanes, !has_mask && packed.count != 0); left != 0;
       left &= left - 1) {
    const int from = __ffs(static_cast<int>(left)) - 1;
    list_by_warp(splats, __shfl_sync(kAllLanes, splat, from), frame,
                 __shfl_sync(kAllLanes, to, from), out);
  }
}

/// Slots of a block staged in shared memory for coalesced writes.
constexpr std::uint32_t kMaxStagedSlots = 2048;

/// Lists the slots by depth of their splats and numbers them in that order.
template <typename Key>
__global__ void __launch_bounds__(kThreads)
    list_kernel(Frame frame, SplatPointers splats, SlotCount count, const std::uint32_t* order,
                Packed* states, List<Key> out) {
  using Scan = cub::BlockScan<std::uint32_t, kThreads>;
  __shared__ typename Scan::TempStorage storage;
  __shared__ unsigned ticket_shared;
  __shared__ std::uint32_t before_shared;
  __shared__ Key tiles_shared[kMaxStagedSlots];
  __shared__ std::uint32_t splats_shared[kMaxStagedSlots];
  const unsigned block = take_ticket(states, gridDim.x, ticket_shared);
  const std::uint32_t rank = block * kThreads + threadIdx.x;
  if (count() == 0) return;
  const bool is_splat = rank < splats.counts->splats;
  const std::uint32_t splat = is_splat ? order[rank] : 0;
  const SlotRange packed = is_splat ? splats.slots[splat] : SlotRange{0, 0};
  const bool has_mask = (packed.begin & kTileMaskFlag) != 0;
  const std::uint32_t slots = has_mask ? packed.count & 0xffffU : packed.count;
  std::uint32_t at = 0;
  std::uint32_t all = 0;
  Scan(storage).ExclusiveSum(slots, at, all);
  if (threadIdx.x < kWarp) {
    const Packed before = count_before(states, block, all);
    if (threadIdx.x == 0) before_shared = slots_in(before);
  }
  const bool is_staged = all <= kMaxStagedSlots;
  if (is_staged) list_splats<Key>(frame, splats, splat, packed, at, {tiles_shared, splats_shared});
  __syncthreads();
  const std::uint32_t to = before_shared;
  if (is_splat) splats.slots[splat] = {to + at, slots};
  if (!is_staged) return list_splats<Key>(frame, splats, splat, packed, to + at, out);
  for (std::uint32_t k = threadIdx.x; k < all; k += kThreads) {
    out.tiles[to + k] = tiles_shared[k];
    out.splats[to + k] = splats_shared[k];
  }
}

/// One warp per tile: initializes its chunks. The order of tiles within a kind of chunks does not
/// affect the result.
__global__ void __launch_bounds__(kThreads) place_chunks_kernel(int tiles, BinPointers bins) {
  const int tile = static_cast<int>((blockIdx.x * kThreads + threadIdx.x) / kWarp);
  const std::uint32_t lane = threadIdx.x % kWarp;
  if (tile >= tiles) return;
  const std::uint32_t slots = bins.tile_begin[tile + 1] - bins.tile_begin[tile];
  const std::uint32_t begin = bins.chunk_begin[tile];
  const std::uint32_t own = bins.chunk_begin[tile + 1] - begin;
  if (lane == 0) {
    bins.last_visible_chunk[tile] = ~0U;
    bins.drawing.finished[tile] = 0;
  }
  for (std::uint32_t k = lane; k < own; k += kWarp) {
    bins.chunk_tile[begin + k] = static_cast<std::uint32_t>(tile);
    bins.drawing.ready[begin + k] = 0;
  }
  for_each_kind(slots, bins.chunk_slots, own, [&](int kind, std::uint32_t first, std::uint32_t n) {
    std::uint32_t at = lane == 0 ? atomicAdd(bins.drawing.kinds + kind, n) : 0;
    at = __shfl_sync(kAllLanes, at, 0);
    for (std::uint32_t k = lane; k < n; k += kWarp) bins.chunk_order[at + k] = begin + first + k;
  });
}

/// State shared by the parts of the binning.
template <typename Key>
struct Binning {
  State state;
  Scratch<Key> scratch;
  SlotCount count;
  SortBuffers<Key> slots;

  Binning(const Frame& frame, const SplatPointers& splats, const BinPointers& out)
      : state(out.state, splats.capacity, splats.slot_capacity, frame),
        scratch(out.scratch, splats.capacity, splats.slot_capacity),
        count{splats.counts, splats.capacity, splats.slot_capacity},
        slots{.keys = {scratch.keys[0], scratch.keys[1]},
              .values = {out.tile_slots, scratch.slots},
              .numbered = out.slot_splat != nullptr} {
    // After the last pass the slots must be in `tile_slots`.
    if (tile_passes(frame.tiles()) % 2 != 0) std::swap(slots.values[0], slots.values[1]);
  }
};

template <typename Key>
cudaError_t list(const Frame& frame, const SplatPointers& splats, const BinPointers& out,
                 cudaStream_t stream) {
  const Binning<Key> binning(frame, splats, out);
  const State& state = binning.state;
  const Scratch<Key>& scratch = binning.scratch;
  const int passes = depth_passes(frame.camera.near_m);
  const SplatCount count = {splats.counts, splats.capacity};
  count_digits<kDepthBits>(splats.depth_keys, count, splats.capacity, passes, state.by_depth,
                           stream);
  const cudaError_t error = sort_pairs<kDepthBits>(
      SortBuffers<std::uint32_t>{.keys = {splats.depth_keys, scratch.depth_keys},
                                 .values = {scratch.orders[0], scratch.orders[1]},
                                 .numbered = true},
      count, splats.capacity, passes, state.by_depth, stream);
  if (error != cudaSuccess) return error;
  const SortBuffers<Key>& slots = binning.slots;
  list_kernel<<<blocks_for(splats.capacity), kThreads, 0, stream>>>(
      frame, splats, binning.count, scratch.orders[passes % 2], state.list,
      List<Key>{slots.keys[0], slots.numbered ? out.slot_splat : slots.values[0]});
  constexpr unsigned kCountBlocks = 132;  // one per multiprocessor of a large device
  count_tiles_kernel<<<kCountBlocks, kCountThreads, 0, stream>>>(
      slots.keys[0], binning.count, frame.tiles(), tile_passes(frame.tiles()), out, state.tiles,
      state.by_tile.counts);
  return cudaGetLastError();
}

template <typename Key>
cudaError_t sort(const Frame& frame, const SplatPointers& splats, const BinPointers& out,
                 cudaStream_t stream) {
  const Binning<Key> binning(frame, splats, out);
  return sort_pairs<kTileBits>(binning.slots, binning.count, splats.slot_capacity,
                               tile_passes(frame.tiles()), binning.state.by_tile, stream);
}

constexpr int kShortKeys = 1 << 16;

}  // namespace

std::uint32_t chunk_slots(std::uint32_t slot_capacity) {
  constexpr std::uint32_t kBlocks = 4096;  // twice the resident blocks of a large device
  return slot_capacity < kMaxChunkSlots * kBlocks ? kMinChunkSlots : kMaxChunkSlots;
}

std::uint32_t chunk_capacity(std::uint32_t slot_capacity, std::uint32_t chunk_slots, int tiles) {
  return slot_capacity / chunk_slots + static_cast<std::uint32_t>(tiles);
}

std::size_t bin_state_bytes(std::uint32_t capacity, std::uint32_t slot_capacity,
                            const Frame& frame) {
  return State(nullptr, capacity, slot_capacity, frame).bytes;
}

std::size_t bin_scratch_bytes(std::uint32_t capacity, std::uint32_t slot_capacity, int tiles) {
  return tiles < kShortKeys ? Scratch<std::uint16_t>(nullptr, capacity, slot_capacity).bytes
                            : Scratch<std::uint32_t>(nullptr, capacity, slot_capacity).bytes;
}

cudaError_t launch_list(const Frame& frame, const SplatPointers& splats, const BinPointers& out,
                        cudaStream_t stream) {
  return frame.tiles() < kShortKeys ? list<std::uint16_t>(frame, splats, out, stream)
                                    : list<std::uint32_t>(frame, splats, out, stream);
}

cudaError_t launch_place_chunks(const Frame& frame, const BinPointers& out, cudaStream_t stream) {
  place_chunks_kernel<<<blocks_for(std::uint64_t{kWarp} * frame.tiles()), kThreads, 0, stream>>>(
      frame.tiles(), out);
  return cudaGetLastError();
}

cudaError_t launch_sort(const Frame& frame, const SplatPointers& splats, const BinPointers& out,
                        cudaStream_t stream) {
  return frame.tiles() < kShortKeys ? sort<std::uint16_t>(frame, splats, out, stream)
                                    : sort<std::uint32_t>(frame, splats, out, stream);
}

}  // namespace apvi::gaussians::cuda
