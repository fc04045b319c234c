// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <filesystem>
#include <memory>

#include "survey/georeference.hpp"
#include "survey/ground_grid.hpp"

/// Raster files. Every function of this header throws InputError in a build without GDAL.
namespace apvi::survey {

enum class RasterKind {
  rgba,       ///< 8 bits each; alpha 0 where unknown
  elevation,  ///< float32 [m]; kNoElevation where unknown
};
inline constexpr double kNoElevation = -9999.0;

/// Writes a raster tile by tile: at the end a cloud-optimized GeoTIFF, that is a tiled GeoTIFF with
/// overviews, compressed by deflate. It appears when `finish` has succeeded.
class GeoTiff {
 public:
  /// Throws InputError for a bad coordinate reference system, RunError when the file cannot be
  /// created.
  GeoTiff(std::filesystem::path file, const GroundGrid& grid, const Georeference& reference,
          RasterKind kind);
  ~GeoTiff();
  GeoTiff(const GeoTiff&) = delete;
  GeoTiff& operator=(const GeoTiff&) = delete;

  /// `values`: rgba [H,W,4] uint8, elevation [H,W] floating with NaN where unknown.
  void write(const GroundTile& tile, const torch::Tensor& values);
  void finish();

 private:
  struct File;
  std::unique_ptr<File> file_;
};

/// Hillshade of an elevation model, as `gdaldem hillshade -compute_edges` makes it (Horn, 1981): a
/// gray GeoTIFF, 0 where unknown. Throws RunError.
void write_hillshade(const std::filesystem::path& elevation, const std::filesystem::path& out);

/// Contour lines of an elevation model every `interval_m` [m], as `gdal_contour` makes them: a
/// GeoPackage with a layer "contours" and the field "elevation". Throws RunError.
void write_contours(const std::filesystem::path& elevation, const std::filesystem::path& out,
                    double interval_m);

}  // namespace apvi::survey
