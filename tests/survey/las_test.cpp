// SPDX-License-Identifier: BSD-3-Clause
#include "survey/las.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>

#include "support/tmp_dir.hpp"
#include "survey/flat_ground.hpp"
#include "survey/poses.hpp"

namespace apvi::survey {
namespace {

std::string read_file(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

/// A file, by the offsets of the LAS 1.4 specification.
class LasFile {
 public:
  explicit LasFile(std::string bytes) : bytes_(std::move(bytes)) {}

  template <typename T>
  T at(std::size_t offset) const {
    T value{};
    std::memcpy(&value, bytes_.data() + offset, sizeof value);
    return value;
  }
  std::size_t point(std::size_t i) const { return at<std::uint32_t>(96) + 36 * i; }
  double coordinate(std::size_t i, std::size_t axis) const {
    return at<double>(155 + 8 * axis) +
           at<double>(131 + 8 * axis) * at<std::int32_t>(point(i) + 4 * axis);
  }
  std::size_t size() const { return bytes_.size(); }
  std::string text(std::size_t offset) const { return bytes_.c_str() + offset; }

 private:
  std::string bytes_;
};

LasFile written(const SurfacePoints& points, const Georeference& reference) {
  const test::TmpDir dir;
  write_las(dir.path() / "p.las", points, reference);
  return LasFile(read_file(dir.path() / "p.las"));
}

SurfacePoints two_points() {
  return {{691234.5671, 5331234.5678, -7.0},
          torch::tensor({{0.0, 0.0, 0.0}, {1.25, -2.0, 0.5}}, torch::kFloat64),
          torch::tensor({{0.0F, 0.5F, 1.0F}, {1.0F, 1.0F, 1.0F}})};
}

TEST(Las, HeaderIsThatOfVersion14WithColors) {
  const LasFile las = written(two_points(), {});
  EXPECT_EQ(las.text(0).substr(0, 4), "LASF");
  EXPECT_EQ(las.at<std::uint16_t>(6), 16);  // WKT
  EXPECT_EQ(las.at<std::uint8_t>(24), 1);   // version
  EXPECT_EQ(las.at<std::uint8_t>(25), 4);
  EXPECT_EQ(las.at<std::uint16_t>(94), 375);  // header
  EXPECT_EQ(las.at<std::uint8_t>(104), 7);    // point format
  EXPECT_EQ(las.at<std::uint16_t>(105), 36);
  EXPECT_EQ(las.at<std::uint32_t>(107), 0U);  // legacy count
  EXPECT_EQ(las.at<std::uint64_t>(247), 2U);  // count
  EXPECT_EQ(las.at<std::uint64_t>(255), 2U);  // first returns
  EXPECT_EQ(las.size(), las.point(2));
  EXPECT_EQ(las.text(375 + 2), "LASF_Projection");
  EXPECT_EQ(las.text(375 + 54).substr(0, 9), "LOCAL_CS[");
}

TEST(Las, UtmCoordinatesKeepTenthsOfAMillimeter) {
  const SurfacePoints points = two_points();
  const LasFile las = written(points, {});
  for (std::size_t i = 0; i < 2; ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<std::int64_t>(axis);
      const double truth = points.anchor[static_cast<Eigen::Index>(axis)] +
                           points.positions[static_cast<std::int64_t>(i)][a].item<double>();
      EXPECT_NEAR(las.coordinate(i, axis), truth, 0.51e-4);
      EXPECT_LE(las.coordinate(i, axis), las.at<double>(179 + 16 * axis) + 1e-9);
      EXPECT_GE(las.coordinate(i, axis), las.at<double>(187 + 16 * axis) - 1e-9);
    }
  }
}

TEST(Las, ColorsHave16Bits) {
  const LasFile las = written(two_points(), {});
  EXPECT_EQ(las.at<std::uint16_t>(las.point(0) + 30), 0);
  EXPECT_EQ(las.at<std::uint16_t>(las.point(0) + 32), 32768);
  EXPECT_EQ(las.at<std::uint16_t>(las.point(0) + 34), 65535);
}

TEST(SurfacePoints, AreTheOpaqueGaussiansWithTheirColorsFromAbove) {
  SurveyMap map = test::plane_map({.side_m = 0.2, .spacing_m = 0.1, .height_m = 3.0},
                                  {Eigen::Quaterniond::Identity(), {100.0, 200.0, 10.0}});
  map.map.gaussians.logit_opacities[0] = -1.0;
  // Brighter from below than from above: the coefficient of z.
  map.map.gaussians.sh_rest = torch::zeros({4, 3, 3});
  map.map.gaussians.sh_rest.select(1, 1).fill_(0.5);
  const SurfacePoints points = surface_points(map, {});
  ASSERT_EQ(points.positions.size(0), 3);
  EXPECT_DOUBLE_EQ(points.anchor.z(), 10.0);
  EXPECT_NEAR(points.positions[0][2].item<double>(), 3.0, 1e-6);
  // The first of them, at (-0.05, 0.05), is cyan: green and blue 1 - 0.4886 * 0.5.
  const torch::Tensor shade = points.colors[0].to(torch::kFloat64);
  EXPECT_NEAR(shade[0].item<double>(), 0.0, 1e-6);
  EXPECT_NEAR(shade[1].item<double>(), 1.0 - 0.4886025 * 0.5, 1e-5);
}

TEST(Poses, AreWrittenWithMillimetersAndUnits) {
  const test::TmpDir dir;
  const SE3 pose{Eigen::Quaterniond(0.5, 0.5, 0.5, 0.5), {691234.5671, 5331234.5, -2.0}};
  write_poses(dir.path() / "p.csv", {{Stamp{1700000000123456789}, pose}});
  EXPECT_EQ(read_file(dir.path() / "p.csv"),
            "stamp_ns,easting_m,northing_m,height_m,qw,qx,qy,qz\n"
            "1700000000123456789,691234.5671,5331234.5000,-2.0000,"
            "0.500000000,0.500000000,0.500000000,0.500000000\n");
}

}  // namespace
}  // namespace apvi::survey
