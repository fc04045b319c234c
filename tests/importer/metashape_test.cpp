// SPDX-License-Identifier: BSD-3-Clause
#include "importer/metashape_model.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "importer/import.hpp"
#include "importer/source_files.hpp"
#include "io/dataset_builder.hpp"

namespace apvi::importer {
namespace {

using namespace test;
using Eigen::Vector2d;
using Eigen::Vector3d;
using testing::HasSubstr;
namespace fs = std::filesystem;

constexpr const char* kLens =
    "<f>40</f><cx>1.5</cx><cy>-0.5</cy><k1>-0.1</k1><k2>0.02</k2><k3>-0.003</k3>"
    "<p1>0.004</p1><p2>-0.005</p2><b1>0.25</b1>";

std::string document(const std::string& lens, const std::string& type = "frame") {
  const auto camera = [](const char* label, double x, const char* sensor = "0") {
    return fmt::format(
        "<camera id=\"0\" sensor_id=\"{}\" label=\"{}\"><transform>1 0 0 {} 0 0 -1 2 0 1 0 3 0 0 0 "
        "1</transform></camera>",
        sensor, label, x);
  };
  return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document version=\"2.0.0\"><chunk "
         "label=\"Chunk 1\"><sensors><sensor id=\"0\" type=\"frame\"><resolution width=\"32\" "
         "height=\"24\"/><calibration type=\"" +
         type + "\" class=\"adjusted\"><resolution width=\"32\" height=\"24\"/>" + lens +
         "</calibration></sensor></sensors><cameras>" + camera("img10.png", 10.0) +
         "<group id=\"0\">" + camera("img2", 2.0) + "</group>" + camera("other", 5.0, "1") +
         "<camera id=\"7\" sensor_id=\"0\" label=\"not aligned\"/></cameras><transform><rotation>1 "
         "0 0 0 1 0 0 0 1</rotation><translation>5 6 7</translation><scale>0.5</scale></transform>"
         "</chunk></document>";
}

// The equations of Metashape's manual, appendix "Camera models".
Vector2d metashape_pixel(const Vector3d& p) {
  const double x = p.x() / p.z();
  const double y = p.y() / p.z();
  const double r2 = x * x + y * y;
  const double radial = 1.0 - 0.1 * r2 + 0.02 * r2 * r2 - 0.003 * r2 * r2 * r2;
  const double p1 = 0.004;
  const double p2 = -0.005;
  const double xd = x * radial + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y;
  const double yd = y * radial + p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y;
  return {16.0 + 1.5 + xd * 40.0 + xd * 0.25, 12.0 - 0.5 + yd * 40.0};
}

TEST(Metashape, TheCameraIsThatOfItsEquations) {
  const MetashapeModel model = parse_metashape(document(kLens), "cameras.xml");
  const CameraModel camera(model.camera);
  for (const Vector3d& point : {Vector3d(0.1, 0.2, 1.0), Vector3d(-0.3, 0.1, 1.5),
                                Vector3d(0.25, -0.2, 0.8), Vector3d(0.0, 0.0, 1.0)}) {
    const auto pixel = camera.project(point);
    ASSERT_TRUE(pixel);
    // There the center of the first pixel is (0.5, 0.5).
    EXPECT_LT((*pixel + Vector2d(0.5, 0.5) - metashape_pixel(point)).norm(), 1e-9);
  }
}

TEST(Metashape, PosesOfAlignedImagesOfOneSensorAreRead) {
  const MetashapeModel model = parse_metashape(document(kLens), "cameras.xml");
  ASSERT_EQ(model.images.size(), 2U);
  EXPECT_EQ(model.of_other_sensors, 1U);
  EXPECT_EQ(model.images[1].label, "img2");
  EXPECT_TRUE(model.images[1].T_model_camera.translation.isApprox(Vector3d(2.0, 2.0, 3.0)));
  EXPECT_TRUE((model.images[1].T_model_camera.rotation * Vector3d::UnitZ())
                  .isApprox(-Vector3d::UnitY(), 1e-12));
  EXPECT_EQ(model.scale, 0.5);
}

TEST(Metashape, AFishEyeIsEquidistant) {
  const MetashapeModel model =
      parse_metashape(document("<f>20</f><k1>0.1</k1><k4>0.01</k4>", "fisheye"), "cameras.xml");
  EXPECT_EQ(model.camera.distortion, Distortion::equidistant);
  EXPECT_EQ(model.camera.coefficients[3], 0.01);
}

TEST(Metashape, WhatCannotBeReadIsAnError) {
  const std::pair<std::string, const char*> files[] = {
      {"<document>", "damaged XML"},
      {"<document/>", "not an export of Metashape"},
      {"<document><chunk/></document>", "no image is aligned"},
      {document("<f>40</f><b2>1</b2>"), "skew (b2)"},
      {document("<f>40</f><k4>1</k4>"), "(k4)"},
      {document("<f>x</f>"), "<f> is not a number"},
      {document("<f>-1</f>"), "focal length -1"},
      {document("<f>40</f>", "spherical"), "type spherical"}};
  for (const auto& [xml, message] : files) {
    EXPECT_THAT(input_error([&] { parse_metashape(xml, "cameras.xml"); }), HasSubstr(message));
  }
}

TEST(MetashapeImport, BecomesImagesWithMetricPoses) {
  const TmpDir dir;
  dir.write("project/cameras.xml", document(kLens));
  write_photo(dir, "project/images/img10.png");
  write_photo(dir, "project/images/img2.png");
  const fs::path out = dir.path() / "dive";
  const ImportResult result = import_source(dir.path() / "project", out, {});
  EXPECT_EQ(result.kind, SourceKind::metashape);
  EXPECT_EQ(result.images, 2U);
  EXPECT_TRUE(result.has_metric_poses);
  const auto reference = io::open_sequence(config_for(out), {})->reference();
  ASSERT_TRUE(reference);
  EXPECT_TRUE(
      reference->poses.at(0).T_world_body.translation.isApprox(Vector3d(1.0, 1.0, 1.5)));  // img2
}

TEST(MetashapeImport, MissingImagesAreAnError) {
  const TmpDir dir;
  const fs::path xml = dir.write("cameras.xml", document(kLens));
  EXPECT_THAT(input_error([&] { import_source(xml, dir.path() / "dive", {}); }),
              HasSubstr("name their folder with --images"));
}

}  // namespace
}  // namespace apvi::importer
