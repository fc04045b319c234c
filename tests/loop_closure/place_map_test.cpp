// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/place_map.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <opencv2/core.hpp>
#include <string>

#include "apvi/core/error.hpp"
#include "floor_dive.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::loop_closure {
namespace {

namespace fs = std::filesystem;

const PlaceMap& floor_map() {
  static const PlaceMap map = map_of(line(-1.5, 1.5, 0.0));
  return map;
}

std::string content_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

void write(const fs::path& file, const std::string& content) {
  std::ofstream(file, std::ios::binary) << content;
}

auto fails_with(const std::string& text) {
  return testing::ThrowsMessage<InputError>(testing::HasSubstr(text));
}

TEST(PlaceMap, PointsLieOnTheFloor) {
  ASSERT_GE(floor_map().places.size(), 8U);
  for (const MapPlace& place : floor_map().places) {
    EXPECT_GT(place.points.size(), 100U);
    EXPECT_EQ(static_cast<std::size_t>(place.descriptors.rows), place.points.size());
    double sum = 0.0;
    for (const Eigen::Vector3f& point : place.points) {
      sum += std::abs((place.T_map_camera * point.cast<double>()).z());
    }
    EXPECT_LT(sum / static_cast<double>(place.points.size()), 0.02);
  }
}

TEST(PlaceMap, FileHasTheSameBits) {
  const test::TmpDir folder;
  save(floor_map(), folder.path() / kPlacesFile);
  const PlaceMap read = load_place_map(find_place_map(folder.path()));
  ASSERT_EQ(read.places.size(), floor_map().places.size());
  for (std::size_t k = 0; k < read.places.size(); ++k) {
    const MapPlace& a = floor_map().places[k];
    const MapPlace& b = read.places[k];
    EXPECT_EQ(a.stamp, b.stamp);
    EXPECT_EQ(a.T_map_camera.translation, b.T_map_camera.translation);
    EXPECT_EQ(a.T_map_camera.rotation.coeffs(), b.T_map_camera.rotation.coeffs());
    EXPECT_EQ(a.points, b.points);
    EXPECT_EQ(cv::norm(a.descriptors, b.descriptors, cv::NORM_INF), 0.0);
  }
}

TEST(PlaceMap, DamagedAndForeignFilesAreRefused) {
  const test::TmpDir folder;
  const fs::path file = folder.path() / kPlacesFile;
  EXPECT_THAT([&] { find_place_map(folder.path() / "none"); }, fails_with("no such run folder"));
  EXPECT_THAT([&] { find_place_map(folder.path()); }, fails_with("run its dive again"));
  save(floor_map(), file);
  const std::string whole = content_of(file);
  write(file, whole.substr(0, whole.size() / 2));
  EXPECT_THAT([&] { load_place_map(file); }, fails_with("ends early"));
  std::string other = whole;
  other[12] = 9;  // the version follows the first line
  write(file, other);
  EXPECT_THAT([&] { find_place_map(folder.path()); }, fails_with("version 9"));
  other = whole;
  other[other.find("sift")] = 'o';
  write(file, other);
  EXPECT_THAT([&] { load_place_map(file); }, fails_with("'oift 128 u8 clahe'"));
  write(file, "ply\nformat ascii 1.0\n");
  EXPECT_THAT([&] { load_place_map(file); }, fails_with("not a file of places"));
  save({}, file);
  EXPECT_THAT([&] { find_place_map(folder.path()); }, fails_with("no places"));
}

}  // namespace
}  // namespace apvi::loop_closure
