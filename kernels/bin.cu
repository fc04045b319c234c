// SPDX-License-Identifier: BSD-3-Clause
// Which splats each tile draws, in which order: splats are sorted by depth, their slots listed in
// that order, and these sorted by tile, which keeps the order within each. Two sorts of short keys
// move fewer bytes than one of long keys (Schütz et al.; Feng et al., "FlashGS", 2024).
#include <cub/block/block_scan.cuh>

#include <utility>

#include "look_back.cuh"
#include "radix_sort.cuh"
#include "tile_count.cuh"

namespace apvi::splat::cuda {
namespace {

constexpr int kThreads = 256;

struct SplatCount {
  const Counts* counts;
  std::uint32_t capacity;

  __device__ std::uint32_t operator()() const { return min(counts->splats, capacity); }
};
/// Slots that are listed: where the room is too small for all, none.
struct SlotCount {
  const Counts* counts;
  std::uint32_t capacity, slot_capacity;

  __device__ std::uint32_t operator()() const {
    return counts->splats <= capacity && counts->slots <= slot_capacity ? counts->slots : 0;
  }
};

/// Digits of the number of a tile.
int tile_passes(int tiles) {
  int passes = 1;
  while (tiles - 1 >> passes * kTileBits != 0) ++passes;
  return passes;
}

/// Cuts memory into parts, each on a boundary of 256 bytes; without memory, it counts.
class Cutter {
 public:
  explicit Cutter(void* start) : start_(static_cast<char*>(start)) {}

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

/// What is zeros in the beginning.
struct State {
  Packed* list;  // [blocks of the listing + 1]
  TileState tiles;
  SortState by_depth, by_tile;
  std::size_t bytes;

  State(void* start, std::uint32_t capacity, std::uint32_t slot_capacity, const Frame& frame) {
    Cutter cutter(start);
    const int by_depths = depth_passes(frame.camera.near_m);
    const int passes = tile_passes(frame.tiles());
    list = cutter.take<Packed>(blocks_for(capacity) + 1);
    const auto tile_count = static_cast<std::size_t>(frame.tiles());
    tiles.slots = cutter.take<std::uint32_t>(tile_count + 1);
    tiles.ended = tiles.slots + tile_count;
    by_depth = cut_sort_state<kDepthBits>(
        cutter.take<std::uint32_t>(sort_state_words<kDepthBits>(capacity, by_depths)), by_depths);
    by_tile = cut_sort_state<kTileBits>(
        cutter.take<std::uint32_t>(sort_state_words<kTileBits>(slot_capacity, passes)), passes);
    bytes = cutter.used();
  }
};

/// What is not. Key: what holds the number of a tile.
template <typename Key>
struct Scratch {
  std::uint32_t* depth_keys;  // [capacity]
  std::uint32_t* orders[2];   // [capacity] of which one becomes the splats by depth
  Key* keys[2];               // [slot_capacity] tiles of the slots
  std::uint32_t* slots;       // [slot_capacity]
  std::size_t bytes;

  Scratch(void* start, std::uint32_t capacity, std::uint32_t slot_capacity) {
    Cutter cutter(start);
    depth_keys = cutter.take<std::uint32_t>(capacity);
    for (auto& order : orders) order = cutter.take<std::uint32_t>(capacity);
    for (auto& key : keys) key = cutter.take<Key>(slot_capacity);
    slots = cutter.take<std::uint32_t>(slot_capacity);
    bytes = cutter.used();
  }
};

/// The slots by depth of their splats.
template <typename Key>
struct List {
  Key* tiles;
  std::uint32_t* splats;
};

/// Writes the slots of one splat in one band of tiles.
template <typename Key>
__device__ void list_band(PixelSpan columns, std::uint32_t splat, int band, const Frame& frame,
                          std::uint32_t to, const List<Key>& out) {
  for (int x = columns.first; x <= columns.last; ++x, ++to) {
    out.tiles[to] = static_cast<Key>(band * frame.tiles_x() + x);
    out.splats[to] = splat;
  }
}

/// The same for all bands, by a whole warp: splats near the camera cover the image.
template <typename Key>
__device__ void list_by_warp(const SplatPointers& splats, std::uint32_t splat, const Frame& frame,
                             std::uint32_t to, const List<Key>& out) {
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  const Splat<float> s = splats.splats[splat];
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
    list_band(columns, splat, band, frame, to + before - own, out);
    to += all;
  }
}

/// Writes the slots of the splats of a warp, each from its place on.
template <typename Key>
__device__ void list_splats(const Frame& frame, const SplatPointers& splats, std::uint32_t splat,
                            const SlotRange& packed, std::uint32_t to, const List<Key>& out) {
  const bool few = (packed.begin & kFewTiles) != 0;
  if (few) {
    const FewTiles tiles = FewTiles::unpack(packed);
    const int corner = tiles.y * frame.tiles_x() + tiles.x;
    std::uint32_t at = to;
    for (unsigned left = tiles.mask; left != 0; left &= left - 1, ++at) {
      const int bit = __ffs(static_cast<int>(left)) - 1;
      out.tiles[at] =
          static_cast<Key>(corner + bit / kTileSquare * frame.tiles_x() + bit % kTileSquare);
      out.splats[at] = splat;
    }
  }
  for (unsigned left = __ballot_sync(kAllLanes, !few && packed.count != 0); left != 0;
       left &= left - 1) {
    const int from = __ffs(static_cast<int>(left)) - 1;
    list_by_warp(splats, __shfl_sync(kAllLanes, splat, from), frame,
                 __shfl_sync(kAllLanes, to, from), out);
  }
}

/// Slots of a block that wait in shared memory, from where they go out in a row.
constexpr std::uint32_t kListRoom = 2048;

/// Lists the slots by depth of their splats, and numbers them in that order.
template <typename Key>
__global__ void __launch_bounds__(kThreads)
    list_kernel(Frame frame, SplatPointers splats, SlotCount count, const std::uint32_t* order,
                Packed* states, List<Key> out) {
  using Scan = cub::BlockScan<std::uint32_t, kThreads>;
  __shared__ typename Scan::TempStorage storage;
  __shared__ unsigned turn_shared;
  __shared__ std::uint32_t before_shared;
  __shared__ Key tiles_shared[kListRoom];
  __shared__ std::uint32_t splats_shared[kListRoom];
  const unsigned block = take_turn(states, gridDim.x, turn_shared);
  const std::uint32_t rank = block * kThreads + threadIdx.x;
  if (count() == 0) return;
  const bool is_splat = rank < splats.counts->splats;
  const std::uint32_t splat = is_splat ? order[rank] : 0;
  const SlotRange packed = is_splat ? splats.slots[splat] : SlotRange{0, 0};
  const bool few = (packed.begin & kFewTiles) != 0;
  const std::uint32_t slots = few ? packed.count & 0xffffU : packed.count;
  std::uint32_t at = 0;
  std::uint32_t all = 0;
  Scan(storage).ExclusiveSum(slots, at, all);
  if (threadIdx.x < kWarp) {
    const Packed before = count_before(states, block, all);
    if (threadIdx.x == 0) before_shared = slots_in(before);
  }
  const bool waits = all <= kListRoom;
  if (waits) list_splats<Key>(frame, splats, splat, packed, at, {tiles_shared, splats_shared});
  __syncthreads();
  const std::uint32_t to = before_shared;
  if (is_splat) splats.slots[splat] = {to + at, slots};
  if (!waits) return list_splats<Key>(frame, splats, splat, packed, to + at, out);
  for (std::uint32_t k = threadIdx.x; k < all; k += kThreads) {
    out.tiles[to + k] = tiles_shared[k];
    out.splats[to + k] = splats_shared[k];
  }
}

/// One warp a tile: what is to be known of its chunks. Which tile comes first among chunks of one
/// kind does not matter to what is drawn.
__global__ void __launch_bounds__(kThreads) place_chunks_kernel(int tiles, BinPointers bins) {
  const int tile = static_cast<int>((blockIdx.x * kThreads + threadIdx.x) / kWarp);
  const std::uint32_t lane = threadIdx.x % kWarp;
  if (tile >= tiles) return;
  const std::uint32_t slots = bins.tile_begin[tile + 1] - bins.tile_begin[tile];
  const std::uint32_t begin = bins.chunk_begin[tile];
  const std::uint32_t own = bins.chunk_begin[tile + 1] - begin;
  if (lane == 0) {
    bins.dark[tile] = ~0U;
    bins.drawing.drawn[tile] = 0;
  }
  for (std::uint32_t k = lane; k < own; k += kWarp) {
    bins.chunk_tile[begin + k] = static_cast<std::uint32_t>(tile);
    bins.drawing.ready[begin + k] = 0;
  }
  for_each_kind(slots, bins.chunk_slots, own, [&](int kind, std::uint32_t first, std::uint32_t n) {
    std::uint32_t at = lane == 0 ? atomicAdd(bins.drawing.kinds + kind, n) : 0;
    at = __shfl_sync(kAllLanes, at, 0);
    for (std::uint32_t k = lane; k < n; k += kWarp) bins.turns[at + k] = begin + first + k;
  });
}

/// What the parts of the binning hand to each other.
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
    // After as many passes as tiles have digits, the slots are where they are wanted.
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
  constexpr unsigned kCountBlocks = 132;  // one for each multiprocessor of a large device
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
  constexpr std::uint32_t kBlocks = 4096;  // twice what a large device runs at once
  return slot_capacity < kMostChunkSlots * kBlocks ? kLeastChunkSlots : kMostChunkSlots;
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

}  // namespace apvi::splat::cuda
