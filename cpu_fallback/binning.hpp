// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "raster_kernels.hpp"

/// Which splats touch which tiles, in the order in which they are drawn.
namespace apvi::splat {

/// Gaussians that one task projects.
inline constexpr std::int64_t kChunk = 1024;

struct TileGrid {
  int width, height;  // [px]

  int columns() const { return (width + kTileSize - 1) / kTileSize; }
  int rows() const { return (height + kTileSize - 1) / kTileSize; }
  int count() const { return columns() * rows(); }
};

/// Runs task(0) to task(n - 1), each as soon as a thread is free.
void for_each_task(std::int64_t n, const std::function<void(std::int64_t)>& task);

/// Tiles of the Gaussians of one chunk, Gaussian by Gaussian.
using ChunkTiles = std::vector<std::uint32_t>;

/// Lists the tiles of splats [begin, end); writes how many each has to slot_count[begin..end).
template <typename T>
ChunkTiles list_tiles(const Splat<T>* splats, std::int64_t begin, std::int64_t end,
                      const TileGrid& grid, std::uint32_t* slot_count);

/// Sorts by tile, within a tile by depth, then index. `tile_begin` [tiles + 1], `entries` [slots].
template <typename T>
void sort_entries(const Splat<T>* splats, std::int64_t count, const std::vector<ChunkTiles>& chunks,
                  const std::uint32_t* slot_begin, const TileGrid& grid, std::uint32_t* tile_begin,
                  Entry* entries);

}  // namespace apvi::splat
