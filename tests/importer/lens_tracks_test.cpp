// SPDX-License-Identifier: BSD-3-Clause
#include "importer/lens_tracks.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "support/tmp_dir.hpp"

namespace apvi::importer {
namespace {

namespace fs = std::filesystem;
constexpr ImageSize kSize{320, 240};
constexpr int kShift = 6;  // per image [px]

// Images of a texture that moves to the left.
std::vector<fs::path> write_images(const test::TmpDir& dir, int count, int shift) {
  cv::Mat noise(240, 320 + count * kShift, CV_8U);
  cv::RNG random(99);
  random.fill(noise, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(noise, noise, {}, 2.0);
  cv::normalize(noise, noise, 0, 255, cv::NORM_MINMAX);
  std::vector<fs::path> files;
  for (int k = 0; k < count; ++k) {
    files.push_back(dir.path() / fmt::format("{:03}.png", k));
    cv::imwrite(files.back().string(), noise(cv::Rect(k * shift, 0, 320, 240)));
  }
  return files;
}

TEST(FollowCorners, FollowsThemThroughSixImagesOfAPart) {
  const test::TmpDir dir;
  const auto segments =
      follow_corners(write_images(dir, 40, kShift), kSize, [] { return false; }).segments;
  ASSERT_EQ(segments.size(), 4U);
  for (const TrackSegment& segment : segments) {
    ASSERT_EQ(segment.images(), 6U);
    EXPECT_GE(segment.tracks.size(), 40U);
    const auto& track = segment.tracks[segment.tracks.size() / 2];
    const Eigen::Vector2d moved = track.back() - track.front();
    EXPECT_NEAR(moved.x(), -54.0, 0.3);  // of nine steps, as a part has a quarter of the images
    EXPECT_NEAR(moved.y(), 0.0, 0.3);
    EXPECT_NEAR((track[3] - track[0]).x(), -30.0, 0.3);
  }
}

TEST(FollowCorners, FindsNothingInImagesThatDoNotMove) {
  const test::TmpDir dir;
  EXPECT_TRUE(
      follow_corners(write_images(dir, 40, 0), kSize, [] { return false; }).segments.empty());
}

TEST(FollowCorners, NeedsFourParts) {
  const test::TmpDir dir;
  const auto never = [] { return false; };
  EXPECT_TRUE(follow_corners(write_images(dir, 11, kShift), kSize, never).segments.empty());
  EXPECT_TRUE(follow_corners({}, kSize, never).segments.empty());
}

TEST(FollowCorners, ReducesLargeImages) {
  const test::TmpDir dir;
  const auto files = write_images(dir, 40, kShift);
  for (const fs::path& file : files) {
    cv::Mat large;
    cv::resize(cv::imread(file.string(), cv::IMREAD_GRAYSCALE), large, {}, 4.0, 4.0,
               cv::INTER_CUBIC);
    cv::imwrite(file.string(), large);
  }
  const FollowedCorners found = follow_corners(files, {1280, 960}, [] { return false; });
  EXPECT_EQ(found.size.width, 640);
  ASSERT_EQ(found.segments.size(), 4U);
  const auto& track = found.segments[0].tracks[0];
  EXPECT_NEAR((track.back() - track.front()).x(), -108.0, 0.6);
}

TEST(FollowCorners, EndsWhenInterrupted) {
  const test::TmpDir dir;
  EXPECT_TRUE(
      follow_corners(write_images(dir, 40, kShift), kSize, [] { return true; }).segments.empty());
}

}  // namespace
}  // namespace apvi::importer
