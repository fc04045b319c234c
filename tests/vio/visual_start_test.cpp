// SPDX-License-Identifier: BSD-3-Clause
#include "vio/visual/visual_start.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "core/random.hpp"
#include "support/simulated_dive.hpp"

namespace apvi::vio {
namespace {

using Eigen::Vector3d;
using Path = std::function<SE3(int)>;  // T_world_camera by frame

constexpr int kFrames = 60;
constexpr double kHeight_m = 2.0;
constexpr double kPixelSigma = 0.3;

// Forward over a floor, looking 25 degrees down.
SE3 forward(int k) {
  const double pitch = 25.0 * kRadiansPerDegree;
  Eigen::Matrix3d R;
  R.col(0) = Vector3d(0.0, -1.0, 0.0);
  R.col(1) = Vector3d(-std::sin(pitch), 0.0, -std::cos(pitch));
  R.col(2) = Vector3d(std::cos(pitch), 0.0, -std::sin(pitch));
  return {Eigen::Quaterniond(R), Vector3d(0.02 * k, 0.0, kHeight_m)};
}

SE3 turning(int k) {
  return {forward(0).rotation * so3::exp(Vector3d(0.002 * k, 0.005 * k, 0.0)),
          forward(0).translation};
}

// Images of a floor with a relief of `relief_m` that reaches to the horizon.
class Floor {
 public:
  Floor(std::uint64_t seed, double relief_m) : random_(seed) {
    for (int n = 0; n < 150; ++n) {
      const double distance = 1.0 / random_.uniform(0.02, 0.6);
      const double across = distance * random_.uniform(-0.8, 0.8);
      points_.emplace_back(distance, across, random_.uniform(-relief_m, relief_m));
    }
  }

  TrackedFrame frame(const Path& path, int k) {
    const CameraModel& camera = rig_.cameras.front().model;
    TrackedFrame tracked;
    tracked.stamp = Stamp{1'000'000'000} + Duration::from_seconds(k / 30.0);
    for (std::size_t n = 0; n < points_.size(); ++n) {
      const auto pixel = camera.project(path(k).inverse() * points_[n]);
      if (!pixel || !camera.in_image(*pixel, 2.0)) continue;
      FeatureObservation seen;
      seen.id = static_cast<std::int64_t>(n);
      seen.pixel = *pixel + Eigen::Vector2d(random_.normal(0.0, kPixelSigma),
                                            random_.normal(0.0, kPixelSigma));
      seen.point = (seen.pixel - Eigen::Vector2d(320.0, 240.0)) / test::SimulatedDive::kFocal;
      seen.track_length = k + 1;
      tracked.observations.push_back(seen);
    }
    return tracked;
  }

  // Every third frame is tried.
  std::optional<VisualStart> start(const Path& path) {
    std::vector<TrackedFrame> frames;
    Config config;
    config.window.max_solve_s = 1e3;
    for (int k = 0; k < kFrames; ++k) {
      frames.push_back(frame(path, k));
      if (k % 3 != 2) continue;
      if (auto found = start_visually(frames, config, rig_, waiting_for)) return found;
    }
    return std::nullopt;
  }

  // Between the motions of the camera over the window, found and true [deg].
  double direction_error_deg(const VisualStart& start, const Path& path) const {
    const SE3& T_body_camera = rig_.cameras.front().T_body_camera;
    const auto& frames = start.window.frames;
    const auto pose_of = [&](const Frame& f) {
      return to_se3(f.state.pose.data()) * T_body_camera;
    };
    const auto index_of = [](const Frame& f) {
      return static_cast<int>(
          std::lround(30.0 * seconds_between(Stamp{1'000'000'000}, f.image_stamp)));
    };
    const Vector3d found =
        (pose_of(*frames.front()).inverse() * pose_of(*frames.back())).translation;
    const Vector3d truth =
        (path(index_of(*frames.front())).inverse() * path(index_of(*frames.back()))).translation;
    return kDegreesPerRadian * std::atan2(found.cross(truth).norm(), found.dot(truth));
  }

  std::string waiting_for;

 private:
  Rig rig_ = test::SimulatedDive::rig();
  Random random_;
  std::vector<Vector3d> points_;
};

TEST(VisualStart, FindsTheMotionAlongAFloorThatReachesToTheHorizon) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Floor floor(seed, 0.2);
    const auto start = floor.start(forward);
    ASSERT_TRUE(start) << seed << ": " << floor.waiting_for;
    EXPECT_LT(floor.direction_error_deg(*start, forward), 5.0) << seed;
  }
}

TEST(VisualStart, NeverTakesTheOtherMotionOverAFlatFloor) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Floor floor(seed, 0.0);
    const auto start = floor.start(forward);
    if (!start) continue;
    EXPECT_LT(floor.direction_error_deg(*start, forward), 10.0) << seed;
  }
}

TEST(VisualStart, WaitsWhileTheCameraOnlyTurns) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Floor floor(seed, 0.2);
    EXPECT_FALSE(floor.start(turning)) << seed;
  }
}

}  // namespace
}  // namespace apvi::vio
