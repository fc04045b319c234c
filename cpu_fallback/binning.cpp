// SPDX-License-Identifier: BSD-3-Clause
#include "binning.hpp"

#include <ATen/Parallel.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>

namespace apvi::splat {
namespace {

/// First and last pixel whose centre lies in [low, high]; empty when first > last.
struct PixelSpan {
  int first, last;
};
template <typename T>
PixelSpan pixels_between(T low, T high, int size) {
  const T half(0.5);
  return {static_cast<int>(std::ceil(std::max(low - half, T(0)))),
          static_cast<int>(std::floor(std::min(high - half, static_cast<T>(size - 1)) + T(1))) - 1};
}

/// Calls f(tile) for the tiles that hold a pixel centre of the splat's ellipse (or nearly so: a
/// band of tiles is taken as a whole).
template <typename T, typename F>
void for_each_tile(const Splat<T>& s, const TileGrid& grid, F&& f) {
  const T reach_y = std::sqrt(s.reach_y2);
  const PixelSpan rows = pixels_between(s.v - reach_y, s.v + reach_y, grid.height);
  for (int band = rows.first / kTileSize; band * kTileSize <= rows.last; ++band) {
    const int top = std::max(rows.first, band * kTileSize);
    const int bottom = std::min(rows.last, band * kTileSize + kTileSize - 1);
    const T low = static_cast<T>(top) + T(0.5) - s.v;
    const T high = static_cast<T>(bottom) + T(0.5) - s.v;
    const T right = std::clamp(s.lean, low, high);
    const T left = std::clamp(-s.lean, low, high);
    const auto half_width = [&s](T dy) {
      return s.half * std::sqrt(std::max(s.reach_y2 - dy * dy, T(0)));
    };
    const PixelSpan columns = pixels_between(s.u + s.slope * left - half_width(left),
                                             s.u + s.slope * right + half_width(right), grid.width);
    if (columns.first > columns.last) continue;
    for (int x = columns.first / kTileSize; x <= columns.last / kTileSize; ++x) {
      f(band * grid.columns() + x);
    }
  }
}

/// Indices of the drawn Gaussians by depth, those of equal depth by index.
std::vector<std::uint32_t> by_depth(const Splat<double>* splats,
                                    std::vector<std::uint32_t> indices) {
  std::stable_sort(indices.begin(), indices.end(),
                   [splats](auto a, auto b) { return splats[a].z < splats[b].z; });
  return indices;
}

/// The bits of a positive float sort as the float does: three stable passes over 11 bits each.
std::vector<std::uint32_t> by_depth(const Splat<float>* splats,
                                    std::vector<std::uint32_t> indices) {
  constexpr std::uint32_t kRadix = 1U << 11U;
  struct Item {
    std::uint32_t key, index;
  };
  std::vector<Item> items(indices.size());
  std::vector<Item> sorted(indices.size());
  std::array<std::vector<std::uint32_t>, 3> starts;
  starts.fill(std::vector<std::uint32_t>(kRadix + 1, 0));
  for (std::size_t i = 0; i < indices.size(); ++i) {
    const auto key = std::bit_cast<std::uint32_t>(splats[indices[i]].z);
    items[i] = {key, indices[i]};
    for (std::uint32_t pass = 0; pass < 3; ++pass) ++starts[pass][(key >> 11 * pass) % kRadix + 1];
  }
  for (std::uint32_t pass = 0; pass < 3; ++pass) {
    std::vector<std::uint32_t>& start = starts[pass];
    for (std::uint32_t k = 1; k < kRadix; ++k) start[k] += start[k - 1];
    for (const Item& item : items) sorted[start[(item.key >> 11 * pass) % kRadix]++] = item;
    std::swap(items, sorted);
  }
  for (std::size_t i = 0; i < indices.size(); ++i) indices[i] = items[i].index;
  return indices;
}

}  // namespace

void for_each_task(std::int64_t n, const std::function<void(std::int64_t)>& task) {
  std::atomic<std::int64_t> next = 0;
  at::parallel_for(0, at::get_num_threads(), 1, [&](std::int64_t, std::int64_t) {
    for (std::int64_t i = next++; i < n; i = next++) task(i);
  });
}

template <typename T>
ChunkTiles list_tiles(const Splat<T>* splats, std::int64_t begin, std::int64_t end,
                      const TileGrid& grid, std::uint32_t* slot_count) {
  ChunkTiles tiles;
  tiles.reserve(static_cast<std::size_t>(4 * (end - begin)));
  for (std::int64_t i = begin; i < end; ++i) {
    const std::size_t before = tiles.size();
    if (splats[i].radius > T(0)) {
      for_each_tile(splats[i], grid,
                    [&tiles](int tile) { tiles.push_back(static_cast<std::uint32_t>(tile)); });
    }
    slot_count[i] = static_cast<std::uint32_t>(tiles.size() - before);
  }
  return tiles;
}

template <typename T>
void sort_entries(const Splat<T>* splats, std::int64_t count, const std::vector<ChunkTiles>& chunks,
                  const std::uint32_t* slot_begin, const TileGrid& grid, std::uint32_t* tile_begin,
                  Entry* entries) {
  std::vector<std::uint32_t> drawn;
  for (std::int64_t i = 0; i < count; ++i) {
    if (slot_begin[i + 1] > slot_begin[i]) drawn.push_back(static_cast<std::uint32_t>(i));
  }
  const std::vector<std::uint32_t> order = by_depth(splats, std::move(drawn));
  // Counting sort by tile in as many parts as there are threads: part by part, the order stays.
  const auto tiles = static_cast<std::size_t>(grid.count());
  const std::size_t parts = static_cast<std::size_t>(at::get_num_threads());
  std::vector<std::uint32_t> starts(parts * tiles, 0);
  const auto for_each_entry = [&](std::size_t part, auto&& f) {
    std::uint32_t* const start = starts.data() + part * tiles;
    const std::size_t end = order.size() * (part + 1) / parts;
    for (std::size_t rank = order.size() * part / parts; rank < end; ++rank) {
      const std::uint32_t i = order[rank];
      const std::int64_t chunk = i / kChunk;
      const ChunkTiles& of_chunk = chunks[static_cast<std::size_t>(chunk)];
      const std::uint32_t first = slot_begin[chunk * kChunk];
      for (std::uint32_t slot = slot_begin[i]; slot < slot_begin[i + 1]; ++slot) {
        f(start[of_chunk[slot - first]], Entry{i, slot});
      }
    }
  };
  for_each_task(static_cast<std::int64_t>(parts), [&](std::int64_t part) {
    for_each_entry(static_cast<std::size_t>(part), [](std::uint32_t& n, Entry) { ++n; });
  });
  std::uint32_t total = 0;
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    tile_begin[tile] = total;
    for (std::size_t part = 0; part < parts; ++part) {
      total += std::exchange(starts[part * tiles + tile], total);
    }
  }
  tile_begin[tiles] = total;
  for_each_task(static_cast<std::int64_t>(parts), [&](std::int64_t part) {
    for_each_entry(static_cast<std::size_t>(part),
                   [&](std::uint32_t& at, Entry entry) { entries[at++] = entry; });
  });
}

template ChunkTiles list_tiles(const Splat<float>*, std::int64_t, std::int64_t, const TileGrid&,
                               std::uint32_t*);
template ChunkTiles list_tiles(const Splat<double>*, std::int64_t, std::int64_t, const TileGrid&,
                               std::uint32_t*);
template void sort_entries(const Splat<float>*, std::int64_t, const std::vector<ChunkTiles>&,
                           const std::uint32_t*, const TileGrid&, std::uint32_t*, Entry*);
template void sort_entries(const Splat<double>*, std::int64_t, const std::vector<ChunkTiles>&,
                           const std::uint32_t*, const TileGrid&, std::uint32_t*, Entry*);

}  // namespace apvi::splat
