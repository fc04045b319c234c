// SPDX-License-Identifier: BSD-3-Clause
// What a build without GDAL has in place of raster files and coordinate reference systems.
#include "apvi/core/error.hpp"
#include "survey/geotiff.hpp"

namespace apvi::survey {
namespace {

[[noreturn]] void fail_without_gdal(const char* what) {
  fail_input("{}: this build has no GDAL; install libgdal-dev and build again", what);
}

}  // namespace

struct GeoTiff::File {};

GeoTiff::GeoTiff(std::filesystem::path, const GroundGrid&, const Georeference&, RasterKind) {
  fail_without_gdal("GeoTIFF");
}
GeoTiff::~GeoTiff() = default;
void GeoTiff::write(const GroundTile&, const torch::Tensor&) {}
void GeoTiff::finish() {}

void write_hillshade(const std::filesystem::path&, const std::filesystem::path&) {
  fail_without_gdal("hillshade");
}

void write_contours(const std::filesystem::path&, const std::filesystem::path&, double) {
  fail_without_gdal("contours");
}

std::string well_known_text(const std::optional<int>& epsg) {
  if (epsg) fail_without_gdal("--epsg");
  return R"(LOCAL_CS["local survey",UNIT["meter",1],AXIS["Easting",EAST],AXIS["Northing",NORTH]])";
}

}  // namespace apvi::survey
