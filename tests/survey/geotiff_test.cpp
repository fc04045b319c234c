// SPDX-License-Identifier: BSD-3-Clause
#include "survey/geotiff.hpp"

#include <gdal_priv.h>
#include <gtest/gtest.h>
#include <ogr_spatialref.h>
#include <ogrsf_frmts.h>
#include <torch/torch.h>

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "support/tmp_dir.hpp"
#include "survey/flat_ground.hpp"
#include "survey/ground_products.hpp"

namespace apvi::survey {
namespace {

namespace fs = std::filesystem;

/// Easting and northing of a place in UTM zone 32.
constexpr double kEast = 691234.5;
constexpr double kNorth = 5331234.5;

class GeoTiffProducts : public testing::Test {
 protected:
  fs::path file(const char* name) const { return dir_.path() / name; }
  static GDALDatasetUniquePtr open(const fs::path& path) {
    return GDALDatasetUniquePtr(GDALDataset::Open(path.c_str(), GDAL_OF_RASTER | GDAL_OF_VECTOR));
  }

  test::TmpDir dir_;
  test::Plane plane_{.side_m = 12.0, .spacing_m = 0.05, .slope = 0.1};
  Georeference reference_{32632, SE3{Eigen::Quaterniond::Identity(), {kEast, kNorth, 0.0}}};
  SurveyMap map_ = test::plane_map(plane_, reference_.T_crs_world);
  GroundProduct product_{map_, reference_, grid_around(bounds_of(map_), 0.01)};
};

TEST_F(GeoTiffProducts, ElevationIsReadBackWithItsSystemNoDataAndOverviews) {
  write_elevation(file("z.tif"), product_);
  const auto tiff = open(file("z.tif"));
  ASSERT_NE(tiff, nullptr);
  EXPECT_STREQ(tiff->GetSpatialRef()->GetAuthorityCode(nullptr), "32632");
  EXPECT_STREQ(tiff->GetMetadataItem("LAYOUT", "IMAGE_STRUCTURE"), "COG");
  EXPECT_STREQ(tiff->GetMetadataItem("COMPRESSION", "IMAGE_STRUCTURE"), "DEFLATE");
  GDALRasterBand& band = *tiff->GetRasterBand(1);
  int has_no_data = 0;
  EXPECT_EQ(band.GetNoDataValue(&has_no_data), kNoElevation);
  EXPECT_EQ(has_no_data, 1);
  EXPECT_GE(band.GetOverviewCount(), 1);
  std::array<double, 6> transform{};
  tiff->GetGeoTransform(transform.data());
  EXPECT_NEAR(transform[0], kEast - 6.0, 0.05);
  EXPECT_NEAR(transform[3], kNorth + 6.0, 0.05);
  EXPECT_DOUBLE_EQ(transform[5], -0.01);
  const int column = 900;
  float height = 0.0F;
  ASSERT_EQ(band.RasterIO(GF_Read, column, 600, 1, 1, &height, 1, 1, GDT_Float32, 0, 0), CE_None);
  const double x = transform[0] + (column + 0.5) * 0.01 - kEast;
  EXPECT_NEAR(height, plane_.height_m + plane_.slope * x, 1e-3);
}

TEST_F(GeoTiffProducts, AreaOfThePlaneIsRight) {
  const std::int64_t known = write_elevation(file("z.tif"), product_);
  EXPECT_NEAR(static_cast<double>(known) * 1e-4, 144.0, 0.02 * 144.0);
}

TEST_F(GeoTiffProducts, OrthomosaicHasColorsAndTransparentSurroundings) {
  GroundProduct product = product_;
  product.grid = grid_around({kEast - 8.0, kNorth - 1.0, kEast + 8.0, kNorth + 1.0}, 0.02);
  write_orthomosaic(file("o.tif"), product, {});
  const auto tiff = open(file("o.tif"));
  ASSERT_NE(tiff, nullptr);
  ASSERT_EQ(tiff->GetRasterCount(), 4);
  EXPECT_EQ(tiff->GetRasterBand(4)->GetColorInterpretation(), GCI_AlphaBand);
  const auto pixel = [&](int column, int row) {
    std::array<unsigned char, 4> rgba{};
    EXPECT_EQ(tiff->RasterIO(GF_Read, column, row, 1, 1, rgba.data(), 1, 1, GDT_Byte, 4, nullptr, 0,
                             0, 0),
              CE_None);
    return rgba;
  };
  EXPECT_EQ(pixel(10, 50)[3], 0);    // 1.8 m outside
  const auto east = pixel(600, 90);  // in the south
  EXPECT_GT(east[0], 200);
  EXPECT_LT(east[1], 20);
  EXPECT_LT(east[2], 20);
  EXPECT_EQ(east[3], 255);
  EXPECT_GT(pixel(200, 90)[2], 200);
  EXPECT_GT(pixel(600, 10)[1], 200);
}

TEST_F(GeoTiffProducts, OrthomosaicIsTransparentWhereHeightsAreUnknownButInGaps) {
  GroundProduct product = product_;
  product.grid = grid_around({kEast - 2.0, kNorth - 1.0, kEast + 2.0, kNorth + 1.0}, 0.02);
  product.heights = [](const torch::Tensor& drawn, const GroundGrid&) {
    torch::Tensor heights = drawn.clone();
    heights.slice(1, 0, 60).fill_(std::nan(""));
    heights.slice(0, 50, 60).slice(1, 120, 130).fill_(std::nan(""));  // a gap
    return heights;
  };
  write_orthomosaic(file("o.tif"), product, {});
  const auto tiff = open(file("o.tif"));
  ASSERT_NE(tiff, nullptr);
  std::vector<unsigned char> alpha(200 * 100);
  ASSERT_EQ(tiff->GetRasterBand(4)->RasterIO(GF_Read, 0, 0, 200, 100, alpha.data(), 200, 100,
                                             GDT_Byte, 0, 0),
            CE_None);
  EXPECT_EQ(alpha[50 * 200 + 45], 0);
  EXPECT_EQ(alpha[50 * 200 + 65], 255);
  EXPECT_EQ(alpha[55 * 200 + 125], 255);
}

TEST_F(GeoTiffProducts, HillshadeOfASlopeIsThatOfHorn) {
  product_.grid = grid_around(bounds_of(map_), 0.05);
  write_elevation(file("z.tif"), product_);
  write_hillshade(file("z.tif"), file("shade.tif"));
  const auto tiff = open(file("shade.tif"));
  ASSERT_NE(tiff, nullptr);
  unsigned char shade = 0;
  ASSERT_EQ(tiff->GetRasterBand(1)->RasterIO(GF_Read, 120, 120, 1, 1, &shade, 1, 1, GDT_Byte, 0, 0),
            CE_None);
  // Light from azimuth 315, altitude 45 degrees; the normal is (-slope, 0, 1).
  const double cosine = (0.5 * plane_.slope + std::sqrt(0.5)) / std::hypot(1.0, plane_.slope);
  EXPECT_NEAR(shade, 1.0 + 254.0 * cosine, 1.5);
}

TEST_F(GeoTiffProducts, ContoursLieAtMultiplesOfTheInterval) {
  product_.grid = grid_around(bounds_of(map_), 0.05);
  write_elevation(file("z.tif"), product_);
  write_contours(file("z.tif"), file("c.gpkg"), 0.25);
  const auto lines = open(file("c.gpkg"));
  ASSERT_NE(lines, nullptr);
  OGRLayer& layer = *lines->GetLayerByName("contours");
  EXPECT_STREQ(layer.GetSpatialRef()->GetAuthorityCode(nullptr), "32632");
  int count = 0;
  for (const auto& feature : layer) {
    const double elevation = feature->GetFieldAsDouble("elevation");
    const OGRLineString& line = *feature->GetGeometryRef()->toLineString();
    const double x = line.getX(line.getNumPoints() / 2) - kEast;
    EXPECT_NEAR(plane_.height_m + plane_.slope * x, elevation, 0.01);
    ++count;
  }
  EXPECT_EQ(count, 5);  // from -7.5 to -6.5 m
}

TEST_F(GeoTiffProducts, FilesAppearOnlyWhenTheyAreFinished) {
  product_.progress = [](double fraction) {
    if (fraction > 0.2) fail_run("stopped");
  };
  EXPECT_THROW(write_elevation(file("z.tif"), product_), RunError);
  EXPECT_TRUE(fs::is_empty(dir_.path()));
}

TEST_F(GeoTiffProducts, ALocalSystemIsInMeters) {
  write_elevation(file("z.tif"), {map_, {}, grid_around(bounds_of(map_), 0.05)});
  const auto tiff = open(file("z.tif"));
  ASSERT_NE(tiff, nullptr);
  ASSERT_NE(tiff->GetSpatialRef(), nullptr);
  EXPECT_TRUE(tiff->GetSpatialRef()->IsLocal());
  EXPECT_DOUBLE_EQ(tiff->GetSpatialRef()->GetLinearUnits(), 1.0);
}

TEST(CoordinateReferenceSystem, OthersThanProjectedInMetersAreRefused) {
  for (const int code : {4326, 2263, 999999}) {  // geographic, in feet, unknown
    EXPECT_THROW(well_known_text(code), InputError) << code;
  }
  EXPECT_NE(well_known_text(32632).find("UTM zone 32N"), std::string::npos);
}

}  // namespace
}  // namespace apvi::survey
