// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "cpu_fallback/raster/raster_kernels.hpp"

/// Which splats touch which tiles, in blending order.
namespace apvi::gaussians {

/// Gaussians projected by one task.
inline constexpr std::int64_t kChunk = 1024;

struct TileGrid {
  int width, height;  // [px]

  int columns() const { return (width + kTileSize - 1) / kTileSize; }
  int rows() const { return (height + kTileSize - 1) / kTileSize; }
  int count() const { return columns() * rows(); }
};

/// Runs task(0) to task(n - 1) with dynamic scheduling.
void for_each_task(std::int64_t n, const std::function<void(std::int64_t)>& task);

/// A visible Gaussian, to be sorted by depth.
template <typename T>
struct Ranked {
  T z;
  std::uint32_t index;
};

/// Tiles touched by the Gaussians of one chunk.
template <typename T>
struct ChunkTiles {
  std::vector<std::uint32_t> tiles;  // in the order of the Gaussians
  std::vector<Ranked<T>> visible;    // Gaussians that touch any tile, by index
};

/// Lists the tiles of splats [begin, end); writes their counts to slot_count[begin..end).
template <typename T>
ChunkTiles<T> list_tiles(const Splat<T>* splats, std::int64_t begin, std::int64_t end,
                         const TileGrid& grid, std::uint32_t* slot_count);

/// The visible Gaussians of all chunks by depth, those of equal depth by index.
template <typename T>
std::vector<Ranked<T>> sort_by_depth(const std::vector<ChunkTiles<T>>& chunks);

/// Stable sort by tile. `tile_of_slot` [slots], `tile_begin` [tiles + 1], `entries` [slots].
template <typename T>
void sort_by_tile(const std::vector<Ranked<T>>& order, const std::uint32_t* slot_begin,
                  const std::uint32_t* tile_of_slot, const TileGrid& grid,
                  std::uint32_t* tile_begin, Entry* entries);

}  // namespace apvi::gaussians
