// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/initial_points.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <opencv2/imgproc.hpp>

#include "apvi/core/error.hpp"
#include "runs/maps/posed_images.hpp"
#include "slam/camera_conversion.hpp"
#include "support/test_data.hpp"
#include "support/tmp_dir.hpp"
#include "support/torch_reference.hpp"

namespace apvi::runs {
namespace {

using testing::HasSubstr;

std::string error_of(const std::filesystem::path& file) {
  try {
    read_colmap_points(file);
  } catch (const InputError& e) {
    return e.what();
  }
  return "no error";
}

TEST(InitialPoints, ReadsColmapText) {
  const test::TmpDir dir;
  const auto file = dir.write("points3D.txt", "# comment\n\n7 1.5 -2 3 255 0 51 0.4 1 2 3 4\n");
  const gaussians::PointCloud points = read_colmap_points(file);
  EXPECT_TRUE(test::tensors_near(points.positions, torch::tensor({{1.5F, -2.0F, 3.0F}}), 0.0));
  EXPECT_TRUE(test::tensors_near(points.colors, torch::tensor({{1.0F, 0.0F, 0.2F}}), 1e-6));
}

TEST(InitialPoints, ColmapPointsAreRelativeToOriginInDoublePrecision) {
  const test::TmpDir dir;
  const auto file = dir.write("points3D.txt", "7 596000.125 6640000.25 3 255 0 51 0.4\n");
  const gaussians::PointCloud points = read_colmap_points(file, {596000.0, 6640000.0, 1.0});
  EXPECT_TRUE(torch::equal(points.positions, torch::tensor({{0.125F, 0.25F, 2.0F}})));
}

TEST(InitialPoints, ConfiguredBoxIsRelativeToOrigin) {
  RunConfig config;
  config.mapping.initial_points = "random";
  config.mapping.initial_box_m = {596000.0, 0.0, 0.0, 596001.0, 1.0, 1.0};
  const gaussians::PointCloud points =
      initial_points(config, mapping::KeyframeStore(), {596000.0, 0.0, 0.0});
  EXPECT_GE(points.positions.min().item<float>(), 0.0F);
  EXPECT_LE(points.positions.max().item<float>(), 1.0F);
}

TEST(InitialPoints, ReportsLineNumberOfInvalidColmapLine) {
  const test::TmpDir dir;
  EXPECT_THAT(error_of(dir.write("p.txt", "# a\n1 2 3\n")), HasSubstr("p.txt:2: expected POINT3D"));
  EXPECT_THAT(error_of(dir.write("p.txt", "1 2 x 4 5 6 7 8\n")),
              HasSubstr("\"x\" is not a number"));
  EXPECT_THAT(error_of(dir.write("p.txt", "1 2 nan 4 5 6 7 8\n")), HasSubstr("p.txt:1"));
}

TEST(InitialPoints, ReportsMissingFileWithItsKey) {
  RunConfig config;
  config.mapping.initial_points = "nowhere.ply";
  try {
    initial_points(config, mapping::KeyframeStore());
    FAIL() << "nothing was thrown";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("mapping.initial_points: nowhere.ply: not sift, not random"));
  }
}

// A wall two meters ahead, seen by cameras side by side with a disparity of `kShift` pixels.
mapping::KeyframeStore wall_images(int count) {
  constexpr int kShift = 4;
  constexpr double kFocal = 200.0;
  cv::Mat wall(120, 160 + kShift * count, CV_8UC3);
  cv::RNG(7).fill(wall, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(wall, wall, {}, 2.0);
  cv::normalize(wall, wall, 0, 255, cv::NORM_MINMAX);
  mapping::KeyframeStore store;
  for (int i = 0; i < count; ++i) {
    const cv::Mat image = wall(cv::Rect(kShift * i, 0, 160, 120)).clone();
    mapping::Keyframe keyframe;
    keyframe.intrinsics = {
        .fx = kFocal, .fy = kFocal, .cx = 80.0, .cy = 60.0, .width = 160, .height = 120};
    keyframe.T_camera_world = torch::eye(4, torch::kFloat64);
    keyframe.T_camera_world[0][3] = -i * kShift * 2.0 / kFocal;
    keyframe.image = slam::to_tensor(image);
    store.add(keyframe);
  }
  return store;
}

TEST(InitialPoints, TriangulatedPointsLieOnWall) {
  const gaussians::PointCloud points = triangulate_points(wall_images(8));
  ASSERT_GT(points.positions.size(0), 100);
  const torch::Tensor off = (points.positions.select(1, 2) - 2.0).abs();
  EXPECT_LT(off.median().item<float>(), 0.02F);
  EXPECT_LT(off.quantile(0.95).item<float>(), 0.2F);
}

TEST(InitialPoints, NoPointsWithoutFeatures) {
  mapping::KeyframeStore store = wall_images(1);
  mapping::Keyframe gray = store[0];
  gray.image = torch::full_like(gray.image, 128);
  mapping::KeyframeStore plain;
  for (int i = 0; i < 3; ++i) {
    gray.T_camera_world = gray.T_camera_world.clone();
    gray.T_camera_world[0][3] = -0.1 * i;
    plain.add(gray);
  }
  EXPECT_EQ(triangulate_points(plain).positions.size(0), 0);
}

TEST(InitialPoints, TriangulatedPointsAgreeWithColmap) {
  APVI_NEEDS_DATA(data, "euroc_v101_posed");
  RunConfig config;
  config.dataset.path = data.string();
  config.dataset.duration_s = 30.0;
  config.mapping.image_scale = 0.5;
  const gaussians::PointCloud points = triangulate_points(load_posed_images(config).store);
  ASSERT_GT(points.positions.size(0), 500);
  const gaussians::PointCloud reference = read_colmap_points(data / "points3D.txt");
  const torch::Tensor nearest =
      std::get<0>(torch::cdist(points.positions, reference.positions).min(1));
  EXPECT_LT(nearest.median().item<float>(), 0.05F);  // [m]; the poses are accurate to a centimeter
}

}  // namespace
}  // namespace apvi::runs
