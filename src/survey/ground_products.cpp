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
constexpr std::int64_t kGapPx = 17;

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

/// A mask [H,W] with its gaps of up to kGapPx pixels filled (morphological closing).
Tensor without_gaps(const Tensor& mask) {
  const auto grown = [](const Tensor& image) {
    return torch::max_pool2d(image, kGapPx, 1, kGapPx / 2);
  };
  const Tensor image = mask.to(torch::kFloat32).view({1, 1, mask.size(0), mask.size(1)});
  return -grown(-grown(image)).view(mask.sizes()) > 0.5;
}

Tensor bytes(const GroundImage& image, const Tensor& confirmed, const ColorRule& colors) {
  const Tensor known = image.known & without_gaps(confirmed);
  const Tensor rgb = colors(image.color) * known.unsqueeze(2);
  const Tensor alpha = known.to(rgb.options()).unsqueeze(2);
  return (torch::cat({rgb, alpha}, 2) * 255.0 + 0.5).to(torch::kUInt8);
}

}  // namespace

void write_orthomosaic(const std::filesystem::path& file, const GroundProduct& product,
                       const ColorRule& colors) {
  GeoTiff out(file, product.grid, product.reference, RasterKind::rgba);
  for_each_tile(product, [&](const GroundTile& tile, const VerticalRenderer& renderer) {
    const GroundImage image = renderer.render(tile.grid);
    const Tensor confirmed = ~product.heights(image.elevation, tile.grid).isnan();
    out.write(tile, bytes(image, confirmed, colors));
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
