// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/calibration.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>

#include "core/random.hpp"

namespace apvi::fusion {
namespace {

using Eigen::Vector3d;

// Eigenvalues of 10^(mean ± width).
RecordedFrame frame_at(Random& random, double mean, double width, int inliers) {
  RecordedFrame frame;
  frame.inliers = inliers;
  for (int k = 0; k < 3; ++k) {
    frame.eigenvalues.rotation(k) = std::pow(10.0, mean + 1.0 + random.uniform(-width, width));
    frame.eigenvalues.position(k) = std::pow(10.0, mean + random.uniform(-width, width));
  }
  return frame;
}

std::vector<RecordedFrame> frames_at(double mean, double width, int inliers, int count) {
  Random random(7);
  std::vector<RecordedFrame> frames;
  for (int i = 0; i < count; ++i) frames.push_back(frame_at(random, mean, width, inliers));
  return frames;
}

TEST(DegeneracyCalibration, SeparatesHealthyFromBlindFrames) {
  const RecordedFrames frames{frames_at(5.0, 0.5, 100, 2000), frames_at(2.0, 0.5, 0, 500)};
  const auto found = calibrate_degeneracy(frames, Normalization::none, 0.01, 3);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->healthy.frames, 2000U);
  EXPECT_EQ(found->healthy.rejected, 0.0);  // a uniform distribution lies inside the semicircle
  EXPECT_EQ(found->blind.rejected, 1.0);
  EXPECT_EQ(found->healthy.directions, 6.0);
  EXPECT_EQ(found->blind.directions, 0.0);
  EXPECT_EQ(found->blind.rejected_by_remap, 1.0);
}

TEST(DegeneracyCalibration, ThresholdIsTheEdgeIfItRejectsNothing) {
  const RecordedFrames frames{frames_at(5.0, 0.5, 100, 2000), {}};
  const auto found = calibrate_degeneracy(frames, Normalization::none, 0.01, 3);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->thresholds.rotation, found->fit.rotation.lower_edge);
  EXPECT_EQ(found->thresholds.position, found->fit.position.lower_edge);
  EXPECT_EQ(found->blind.frames, 0U);
}

TEST(DegeneracyCalibration, LowersAnEdgeThatRejectsTooMany) {
  RecordedFrames frames{frames_at(5.0, 0.2, 100, 950), {}};
  for (const RecordedFrame& tail : frames_at(3.0, 0.2, 100, 50)) frames.healthy.push_back(tail);
  const auto strict = calibrate_degeneracy(frames, Normalization::none, 0.5, 3);
  const auto mild = calibrate_degeneracy(frames, Normalization::none, 0.02, 3);
  ASSERT_TRUE(strict && mild);
  EXPECT_EQ(strict->thresholds.position, strict->fit.position.lower_edge);
  EXPECT_NEAR(strict->healthy.rejected, 0.05, 1e-12);
  EXPECT_LT(mild->thresholds.position, mild->fit.position.lower_edge);
  EXPECT_LE(mild->healthy.rejected, 0.02);
  EXPECT_GT(mild->healthy.rejected, 0.0);
  EXPECT_NEAR(mild->healthy_at_edge.rejected, 0.05, 1e-12);
}

TEST(DegeneracyCalibration, PerInlierNormalizationHidesABlindWindow) {
  // Blind frames are divided by one, frames with a hundred corners by a hundred.
  const RecordedFrames frames{frames_at(5.0, 0.2, 100, 1000), frames_at(4.0, 0.2, 0, 200)};
  const auto plain = calibrate_degeneracy(frames, Normalization::none, 0.01, 3);
  const auto divided = calibrate_degeneracy(frames, Normalization::per_inlier, 0.01, 3);
  ASSERT_TRUE(plain && divided);
  EXPECT_EQ(plain->blind.rejected, 1.0);
  EXPECT_EQ(divided->blind.rejected, 0.0);
  EXPECT_NEAR(divided->thresholds.position, 0.01 * plain->thresholds.position,
              1e-9 * plain->thresholds.position);
}

TEST(DegeneracyCalibration, RemappingRejectsOnlyWithTooFewDirections) {
  RecordedFrame weak;
  weak.eigenvalues = {Vector3d(5.0, 20.0, 20.0), Vector3d(5.0, 5.0, 20.0)};
  const ThresholdOutcome three = evaluate_thresholds({weak}, {10.0, 10.0}, Normalization::none, 3);
  EXPECT_EQ(three.rejected, 1.0);
  EXPECT_EQ(three.directions, 3.0);
  EXPECT_EQ(three.rejected_by_remap, 0.0);
  EXPECT_EQ(evaluate_thresholds({weak}, {10.0, 10.0}, Normalization::none, 4).rejected_by_remap,
            1.0);
}

TEST(DegeneracyCalibration, ReturnsNulloptForDegenerateInput) {
  EXPECT_FALSE(calibrate_degeneracy({}, Normalization::none, 0.01, 3));
  EXPECT_FALSE(
      calibrate_degeneracy({frames_at(5.0, 0.0, 100, 50), {}}, Normalization::none, 0.01, 3));
}

}  // namespace
}  // namespace apvi::fusion
