// SPDX-License-Identifier: BSD-3-Clause
#include "cpu_fallback/raster/binning.hpp"

#include <ATen/Parallel.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <utility>

namespace apvi::gaussians {
namespace {

/// Calls f(tile) for the tiles that contain a pixel center of the splat's ellipse (conservative:
/// computed per row of tiles).
template <typename T, typename F>
void for_each_tile(const Splat<T>& s, const TileGrid& grid, F&& f) {
  const PixelSpan rows = row_span(s, grid.height);
  for (int tile_row = rows.first / kTileSize; tile_row * kTileSize <= rows.last; ++tile_row) {
    const PixelSpan columns = tile_column_span(s, rows, tile_row, grid.width);
    for (int x = columns.first; x <= columns.last; ++x) f(tile_row * grid.columns() + x);
  }
}

void sort_in_place(std::vector<Ranked<double>>& items) {
  std::stable_sort(items.begin(), items.end(),
                   [](const auto& a, const auto& b) { return a.z < b.z; });
}

/// The bits of positive floats sort like the floats: three stable radix passes of 11 bits.
void sort_in_place(std::vector<Ranked<float>>& items) {
  constexpr std::uint32_t kRadix = 1U << 11U;
  const auto digit = [](const Ranked<float>& item, std::uint32_t pass) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, &item.z, sizeof bits);
    return (bits >> 11U * pass) % kRadix;
  };
  std::array<std::array<std::uint32_t, kRadix + 1>, 3> starts = {};
  for (const Ranked<float>& item : items) {
    for (std::uint32_t pass = 0; pass < 3; ++pass) ++starts[pass][digit(item, pass) + 1];
  }
  std::vector<Ranked<float>> sorted(items.size());
  for (std::uint32_t pass = 0; pass < 3; ++pass) {
    auto& start = starts[pass];
    for (std::uint32_t k = 1; k < kRadix; ++k) start[k] += start[k - 1];
    for (const Ranked<float>& item : items) sorted[start[digit(item, pass)]++] = item;
    std::swap(items, sorted);
  }
}

}  // namespace

void for_each_task(std::int64_t n, const std::function<void(std::int64_t)>& task) {
  std::atomic<std::int64_t> next = 0;
  at::parallel_for(0, at::get_num_threads(), 1, [&](std::int64_t, std::int64_t) {
    for (std::int64_t i = next++; i < n; i = next++) task(i);
  });
}

template <typename T>
ChunkTiles<T> list_tiles(const Splat<T>* splats, std::int64_t begin, std::int64_t end,
                         const TileGrid& grid, std::uint32_t* slot_count) {
  ChunkTiles<T> out;
  out.tiles.reserve(static_cast<std::size_t>(4 * (end - begin)));
  out.visible.reserve(static_cast<std::size_t>(end - begin));
  for (std::int64_t i = begin; i < end; ++i) {
    const std::size_t before = out.tiles.size();
    if (splats[i].radius > T(0)) {
      for_each_tile(splats[i], grid,
                    [&out](int tile) { out.tiles.push_back(static_cast<std::uint32_t>(tile)); });
    }
    slot_count[i] = static_cast<std::uint32_t>(out.tiles.size() - before);
    if (slot_count[i] > 0) out.visible.push_back({splats[i].z, static_cast<std::uint32_t>(i)});
  }
  return out;
}

template <typename T>
std::vector<Ranked<T>> sort_by_depth(const std::vector<ChunkTiles<T>>& chunks) {
  std::size_t count = 0;
  for (const ChunkTiles<T>& chunk : chunks) count += chunk.visible.size();
  std::vector<Ranked<T>> out;
  out.reserve(count);
  for (const ChunkTiles<T>& chunk : chunks) {
    out.insert(out.end(), chunk.visible.begin(), chunk.visible.end());
  }
  sort_in_place(out);
  return out;
}

template <typename T>
void sort_by_tile(const std::vector<Ranked<T>>& order, const std::uint32_t* slot_begin,
                  const std::uint32_t* tile_of_slot, const TileGrid& grid,
                  std::uint32_t* tile_begin, Entry* entries) {
  // Stable counting sort with one part per thread.
  const auto tiles = static_cast<std::size_t>(grid.count());
  const auto parts = static_cast<std::size_t>(at::get_num_threads());
  std::vector<std::uint32_t> starts(parts * tiles, 0);
  const auto for_each_entry = [&](std::int64_t number, auto&& f) {
    const auto part = static_cast<std::size_t>(number);
    std::uint32_t* const start = starts.data() + part * tiles;
    const std::size_t end = order.size() * (part + 1) / parts;
    for (std::size_t rank = order.size() * part / parts; rank < end; ++rank) {
      const std::uint32_t i = order[rank].index;
      for (std::uint32_t slot = slot_begin[i]; slot < slot_begin[i + 1]; ++slot) {
        f(start[tile_of_slot[slot]], Entry{i, slot});
      }
    }
  };
  const auto count = static_cast<std::int64_t>(parts);
  for_each_task(count, [&](std::int64_t part) {
    for_each_entry(part, [](std::uint32_t& n, Entry) { ++n; });
  });
  std::uint32_t total = 0;
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    tile_begin[tile] = total;
    for (std::size_t part = 0; part < parts; ++part) {
      total += std::exchange(starts[part * tiles + tile], total);
    }
  }
  tile_begin[tiles] = total;
  for_each_task(count, [&](std::int64_t part) {
    for_each_entry(part, [entries](std::uint32_t& at, Entry entry) { entries[at++] = entry; });
  });
}

template ChunkTiles<float> list_tiles(const Splat<float>*, std::int64_t, std::int64_t,
                                      const TileGrid&, std::uint32_t*);
template ChunkTiles<double> list_tiles(const Splat<double>*, std::int64_t, std::int64_t,
                                       const TileGrid&, std::uint32_t*);
template std::vector<Ranked<float>> sort_by_depth(const std::vector<ChunkTiles<float>>&);
template std::vector<Ranked<double>> sort_by_depth(const std::vector<ChunkTiles<double>>&);
template void sort_by_tile(const std::vector<Ranked<float>>&, const std::uint32_t*,
                           const std::uint32_t*, const TileGrid&, std::uint32_t*, Entry*);
template void sort_by_tile(const std::vector<Ranked<double>>&, const std::uint32_t*,
                           const std::uint32_t*, const TileGrid&, std::uint32_t*, Entry*);

}  // namespace apvi::gaussians
