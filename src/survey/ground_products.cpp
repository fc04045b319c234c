// SPDX-License-Identifier: BSD-3-Clause
#include "survey/ground_products.hpp"

#include <torch/torch.h>

#include <vector>

#include "survey/geotiff.hpp"
#include "survey/vertical_renderer.hpp"

namespace apvi::survey {
namespace {

using torch::Tensor;

constexpr std::int64_t kTileSide = 512;

/// Calls use(tile, renderer) for every tile.
void for_each_tile(const GroundProduct& product,
                   const std::function<void(const GroundTile&, const VerticalRenderer&)>& use) {
  const VerticalRenderer renderer(product.map);
  const std::vector<GroundTile> tiles = tiles_of(product.grid, kTileSide);
  double done = 0.0;
  for (const GroundTile& tile : tiles) {
    product.progress(done / static_cast<double>(tiles.size()));
    use(tile, renderer);
    done += 1.0;
  }
}

/// A tile with the next row and column of pixels, where the grid has them.
GroundGrid with_next(const GroundTile& tile, const GroundGrid& whole) {
  GroundGrid grid = tile.grid;
  if (tile.column + grid.width < whole.width) ++grid.width;
  if (tile.row + grid.height < whole.height) ++grid.height;
  return grid;
}

Tensor bytes(const GroundImage& image, const ColorRule& colors) {
  const Tensor rgb = colors(image.color) * image.known.unsqueeze(2);
  const Tensor alpha = image.known.to(rgb.options()).unsqueeze(2);
  return (torch::cat({rgb, alpha}, 2) * 255.0 + 0.5).to(torch::kUInt8);
}

}  // namespace

void write_orthomosaic(const std::filesystem::path& file, const GroundProduct& product,
                       const ColorRule& colors) {
  GeoTiff out(file, product.grid, product.reference, RasterKind::rgba);
  for_each_tile(product, [&](const GroundTile& tile, const VerticalRenderer& renderer) {
    out.write(tile, bytes(renderer.render(tile.grid), colors));
  });
  out.finish();
}

std::int64_t write_elevation(const std::filesystem::path& file, const GroundProduct& product) {
  GeoTiff out(file, product.grid, product.reference, RasterKind::elevation);
  std::int64_t known = 0;
  for_each_tile(product, [&](const GroundTile& tile, const VerticalRenderer& renderer) {
    const Tensor heights = product.heights(renderer.render(tile.grid).elevation, tile.grid);
    out.write(tile, heights);
    known += (~heights.isnan()).sum().item<std::int64_t>();
  });
  out.finish();
  return known;
}

TerrainStatistics terrain_of(const GroundProduct& product) {
  TerrainStatistics terrain(product.grid.resolution_m);
  for_each_tile(product, [&](const GroundTile& tile, const VerticalRenderer& renderer) {
    const GroundGrid grid = with_next(tile, product.grid);
    terrain.add(product.heights(renderer.render(grid).elevation, grid));
  });
  return terrain;
}

}  // namespace apvi::survey
