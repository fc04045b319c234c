// SPDX-License-Identifier: BSD-3-Clause
#include "survey/geotiff.hpp"

#include <cpl_vsi.h>
#include <torch/torch.h>

#include <array>
#include <string>
#include <system_error>
#include <utility>

#include "apvi/core/error.hpp"
#include "survey/gdal_support.hpp"

namespace apvi::survey {
namespace {

namespace fs = std::filesystem;

int bands_of(RasterKind kind) {
  return kind == RasterKind::rgba ? 4 : 1;
}

void describe(GDALDataset& dataset, const GroundGrid& grid, const Georeference& reference,
              RasterKind kind) {
  std::array<double, 6> transform = {grid.west, grid.resolution_m, 0.0, grid.north,
                                     0.0,       -grid.resolution_m};
  dataset.SetGeoTransform(transform.data());
  const OGRSpatialReference system = spatial_reference(reference.epsg);
  dataset.SetSpatialRef(&system);
  if (kind == RasterKind::elevation) {
    dataset.GetRasterBand(1)->SetNoDataValue(kNoElevation);
    dataset.GetRasterBand(1)->SetUnitType("m");
  }
}

/// GDAL's dimensions are ints.
CPLErr write_window(GDALDataset& dataset, const GroundTile& tile, const torch::Tensor& values,
                    GDALDataType type, int bands) {
  const auto bytes = static_cast<GSpacing>(values.element_size());
  const auto width = static_cast<int>(tile.grid.width);
  const auto height = static_cast<int>(tile.grid.height);
  return dataset.RasterIO(GF_Write, static_cast<int>(tile.column), static_cast<int>(tile.row),
                          width, height, values.data_ptr(), width, height, type, bands, nullptr,
                          bytes * bands, bytes * bands * width, bytes, nullptr);
}

}  // namespace

struct GeoTiff::File {
  fs::path final;
  fs::path plain;  ///< without overviews, tile by tile
  fs::path ready;  ///< with them, before it is renamed
  RasterKind kind;
  GdalDataset dataset{};

  ~File() {
    dataset.reset();
    std::error_code ignored;
    fs::remove(plain, ignored);
    fs::remove(ready, ignored);
  }
};

GeoTiff::GeoTiff(fs::path file, const GroundGrid& grid, const Georeference& reference,
                 RasterKind kind)
    : file_(std::make_unique<File>()) {
  file_->plain = file.string() + ".tiles";
  file_->ready = file.string() + ".partial";
  file_->final = std::move(file);
  file_->kind = kind;
  const CPLStringList options = gdal_options({"TILED=YES", "BIGTIFF=IF_SAFER", "COMPRESS=DEFLATE",
                                              "ZLEVEL=1", "INTERLEAVE=PIXEL", "SPARSE_OK=TRUE"});
  file_->dataset.reset(gdal_driver("GTiff").Create(
      file_->plain.c_str(), static_cast<int>(grid.width), static_cast<int>(grid.height),
      bands_of(kind), kind == RasterKind::rgba ? GDT_Byte : GDT_Float32, options.List()));
  if (!file_->dataset) fail_gdal(file_->plain, "cannot be created");
  describe(*file_->dataset, grid, reference, kind);
}

GeoTiff::~GeoTiff() = default;

void GeoTiff::write(const GroundTile& tile, const torch::Tensor& values) {
  const bool colors = file_->kind == RasterKind::rgba;
  const torch::Tensor block =
      colors ? values.to(torch::kCPU, torch::kUInt8).contiguous()
             : values.to(torch::kCPU, torch::kFloat32).nan_to_num(kNoElevation).contiguous();
  if (write_window(*file_->dataset, tile, block, colors ? GDT_Byte : GDT_Float32,
                   bands_of(file_->kind)) != CE_None) {
    fail_gdal(file_->plain, "cannot be written");
  }
}

void GeoTiff::finish() {
  if (GDALFlushCache(file_->dataset.get()); CPLGetLastErrorType() >= CE_Failure) {
    fail_gdal(file_->plain, "cannot be written");
  }
  const CPLStringList options =
      gdal_options({"COMPRESS=DEFLATE", "PREDICTOR=YES", "BIGTIFF=IF_SAFER", "BLOCKSIZE=256",
                    "OVERVIEW_RESAMPLING=AVERAGE"});
  GdalDataset made(gdal_driver("COG").CreateCopy(file_->ready.c_str(), file_->dataset.get(), FALSE,
                                                 options.List(), nullptr, nullptr));
  if (!made) fail_gdal(file_->ready, "cannot be written");
  made.reset();
  move_into_place(file_->ready, file_->final);
}

}  // namespace apvi::survey
