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

/// A drawn Gaussian, to be sorted by depth.
template <typename T>
struct Ranked {
  T z;
  std::uint32_t index;
};

/// What the Gaussians of one chunk touch.
template <typename T>
struct ChunkTiles {
  std::vector<std::uint32_t> tiles;  // Gaussian by Gaussian
  std::vector<Ranked<T>> drawn;      // those that touch any, by index
};

/// Lists the tiles of splats [begin, end); writes how many each has to slot_count[begin..end).
template <typename T>
ChunkTiles<T> list_tiles(const Splat<T>* splats, std::int64_t begin, std::int64_t end,
                         const TileGrid& grid, std::uint32_t* slot_count);

/// The drawn Gaussians of all chunks by depth, those of equal depth by index.
template <typename T>
std::vector<Ranked<T>> sort_by_depth(const std::vector<ChunkTiles<T>>& chunks);

/// Sorts by tile, within a tile in the order given. `tile_of_slot` [slots], `tile_begin` [tiles +
/// 1], `entries` [slots].
template <typename T>
void sort_by_tile(const std::vector<Ranked<T>>& order, const std::uint32_t* slot_begin,
                  const std::uint32_t* tile_of_slot, const TileGrid& grid,
                  std::uint32_t* tile_begin, Entry* entries);

}  // namespace apvi::splat
