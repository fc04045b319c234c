// SPDX-License-Identifier: BSD-3-Clause
// Products of an elevation model by GDAL's own algorithms.
#include <gdal_alg.h>
#include <gdal_utils.h>
#include <ogrsf_frmts.h>

#include <string>
#include <system_error>

#include "apvi/core/error.hpp"
#include "survey/gdal_support.hpp"
#include "survey/geotiff.hpp"

namespace apvi::survey {
namespace {

namespace fs = std::filesystem;

GdalDataset open(const fs::path& file) {
  GdalDataset dataset(GDALDataset::Open(file.c_str(), GDAL_OF_RASTER | GDAL_OF_VERBOSE_ERROR));
  if (!dataset) fail_gdal(file, "cannot be read");
  return dataset;
}

/// `system` is a copy, since GDAL before 3.10 takes no constant one.
OGRLayer& contour_layer(GDALDataset& lines, OGRSpatialReference system, const fs::path& file) {
  OGRLayer* const layer = lines.CreateLayer("contours", &system, wkbLineString, nullptr);
  OGRFieldDefn elevation("elevation", OFTReal);
  if (layer == nullptr || layer->CreateField(&elevation) != OGRERR_NONE) {
    fail_gdal(file, "cannot be written");
  }
  return *layer;
}

void add_contours(GDALDataset& model, GDALDataset& lines, double interval_m, const fs::path& file) {
  OGRLayer& layer = contour_layer(lines, *model.GetSpatialRef(), file);
  const std::string interval = "LEVEL_INTERVAL=" + std::to_string(interval_m);
  const std::string unknown = "NODATA=" + std::to_string(kNoElevation);
  const CPLStringList options = gdal_options({interval.c_str(), unknown.c_str(), "ELEV_FIELD=0"});
  if (layer.StartTransaction() != OGRERR_NONE ||
      GDALContourGenerateEx(model.GetRasterBand(1), &layer, options.List(), nullptr, nullptr) !=
          CE_None ||
      layer.CommitTransaction() != OGRERR_NONE) {
    fail_gdal(file, "cannot be written");
  }
}

}  // namespace

void write_hillshade(const fs::path& elevation, const fs::path& out) {
  const GdalDataset model = open(elevation);
  CPLStringList arguments = gdal_options(
      {"-compute_edges", "-of", "COG", "-co", "COMPRESS=DEFLATE", "-co", "BLOCKSIZE=256"});
  GDALDEMProcessingOptions* const options = GDALDEMProcessingOptionsNew(arguments.List(), nullptr);
  int usage_error = 0;
  const std::string partial = out.string() + ".partial";
  GDALDatasetH made =
      GDALDEMProcessing(partial.c_str(), model.get(), "hillshade", nullptr, options, &usage_error);
  GDALDEMProcessingOptionsFree(options);
  if (made == nullptr) fail_gdal(out, "cannot be written");
  GDALClose(made);
  move_into_place(partial, out);
}

void write_contours(const fs::path& elevation, const fs::path& out, double interval_m) {
  const GdalDataset model = open(elevation);
  fs::path partial = out;
  partial.replace_extension(".partial.gpkg");
  std::error_code ignored;
  fs::remove(partial, ignored);
  GdalDataset lines(gdal_driver("GPKG").Create(partial.c_str(), 0, 0, 0, GDT_Unknown, nullptr));
  if (!lines) fail_gdal(out, "cannot be created");
  add_contours(*model, *lines, interval_m, out);
  lines.reset();
  move_into_place(partial, out);
}

}  // namespace apvi::survey
