// SPDX-License-Identifier: BSD-3-Clause
#include "vio/initialization/initializer.hpp"

#include <gtest/gtest.h>

#include <set>
#include <string>

#include "vio/initialization/closed_form_start.hpp"
#include "vio/initialization/gyro_bias_from_rays.hpp"
#include "vio/start_scene.hpp"

namespace apvi {
namespace {

using Eigen::Vector3d;
using test::StartRecording;
using test::StartScene;
using vio::InitConfig;
using vio::InitStatus;

StartRecording shaken(const StartScene& scene) {
  return {scene, test::shaken_spline(scene.seed, 0.15, 0.2, Vector3d(0.3, 0.1, 0.0))};
}

InitConfig calibrated() {
  InitConfig config;
  config.pixel_sigma = 0.5;
  config.accel_bias_sigma = 0.1;
  return config;
}

TEST(Initializer, EstimatesMotionGravityAndGyroBiasOfAHandheldCamera) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const StartScene scene{.seed = seed};
    const StartRecording recording = shaken(scene);
    const vio::InitResult start = recording.start(calibrated());
    ASSERT_EQ(start.status, InitStatus::success) << seed << ": " << start.detail;
    ASSERT_EQ(start.states.size(), recording.frames().size());
    EXPECT_NEAR(test::scale_of(start, recording), 1.0, 0.1) << seed;
    EXPECT_LT((start.states[0].gyro_bias - scene.gyro_bias).norm(), 0.01) << seed;
    for (std::size_t k = 0; k < start.states.size(); ++k) {
      const imu::NavState truth = recording.truth(k);
      EXPECT_LT(test::tilt_error(start.states[k], truth), 0.03) << seed;
      EXPECT_LT((start.states[k].v_body - truth.v_body).norm(), 0.1) << seed;
    }
  }
}

TEST(Initializer, WorldIsGravityAlignedAndStartsAtTheOrigin) {
  const vio::InitResult start = shaken({.seed = 3}).start(calibrated());
  ASSERT_EQ(start.status, InitStatus::success) << start.detail;
  EXPECT_NEAR(so3::yaw(start.states[0].R_world_body), 0.0, 1e-9);
  EXPECT_LT(start.states[0].p_world.norm(), 1e-9);
}

TEST(Initializer, ScaleIsConsistent) {
  double nees = 0.0;
  const int seeds = 40;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    Random random(1000 + seed);
    StartScene scene{.seed = seed};
    scene.accel_bias = test::normal_vector(random, 0.1);
    const StartRecording recording = shaken(scene);
    const vio::InitResult start = recording.start(calibrated());
    ASSERT_EQ(start.status, InitStatus::success) << seed << ": " << start.detail;
    const double error = (test::scale_of(start, recording) - 1.0) / start.scale_sigma;
    nees += error * error / seeds;
  }
  // Chi-square with 40 degrees of freedom lies in 40 * [0.41, 1.92] with 99.9 % probability; robust
  // weights and the approximate scale need some slack.
  EXPECT_GT(nees, 0.3);
  EXPECT_LT(nees, 2.0);
}

TEST(Initializer, RobustToAThirdOfMovingTracks) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const StartRecording recording = shaken({.seed = seed, .points = 200, .outliers = 0.3});
    const vio::InitResult start = recording.start(calibrated());
    ASSERT_EQ(start.status, InitStatus::success) << seed << ": " << start.detail;
    EXPECT_NEAR(test::scale_of(start, recording), 1.0, 0.1) << seed;
    EXPECT_LT(test::tilt_error(start.states[0], recording.truth(0)), 0.03) << seed;
  }
}

TEST(Initializer, RejectsConstantVelocity) {
  int uncertain = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const StartRecording recording({.seed = seed},
                                   test::shaken_spline(seed, 0.0, 0.0, Vector3d(0.0, 0.5, 0.1)));
    const InitStatus status = recording.start({}).status;
    EXPECT_NE(status, InitStatus::success) << seed;
    if (status == InitStatus::scale_uncertain) ++uncertain;
  }
  // The other attempts converged to zero scale, where nothing fits.
  EXPECT_GE(uncertain, 6);
}

// A survey at nearly constant speed, with variations of centimeters: corner noise is mistaken for
// acceleration and biases the scale toward zero.
TEST(Initializer, NearlyConstantVelocityGivesTheTrueScaleOrIsRejected) {
  int accepted = 0;
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    const int frames = 12 + 2 * static_cast<int>(seed);  // 0.65 to 3.6 s
    const StartRecording recording({.seed = seed, .frames = frames, .points = 300},
                                   test::shaken_spline(seed, 0.01, 0.02, Vector3d(0.4, 0.2, 0.0)));
    const vio::InitResult start = recording.start({});
    if (start.status != InitStatus::success) continue;
    ++accepted;
    EXPECT_NEAR(test::scale_of(start, recording), 1.0, 0.3) << seed << ": " << start.detail;
  }
  EXPECT_GE(accepted, 3);
}

TEST(Initializer, RejectsPureRotation) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    StartScene scene{.seed = seed};
    const StartRecording recording(scene, test::shaken_spline(seed, 0.0, 0.2, Vector3d::Zero()));
    const InitStatus status = recording.start({}).status;
    EXPECT_EQ(status, InitStatus::too_little_parallax) << seed << to_string(status);
  }
}

TEST(Initializer, RejectsAStationaryCamera) {
  const StartRecording recording({}, test::shaken_spline(1, 0.0, 0.0, Vector3d::Zero()));
  EXPECT_EQ(recording.start({}).status, InitStatus::too_little_parallax);
}

TEST(Initializer, RejectsTooFewTracks) {
  EXPECT_EQ(shaken({.points = 20}).start({}).status, InitStatus::too_few_tracks);
}

TEST(Initializer, RejectsTooFewFrames) {
  EXPECT_EQ(shaken({.frames = 5}).start({}).status, InitStatus::too_few_frames);
  EXPECT_EQ(vio::initialize({}, {}, {}, 9.81, {}).status, InitStatus::too_few_frames);
}

TEST(Initializer, ReportsMissingInertialSamples) {
  const StartRecording recording = shaken({});
  std::vector<vio::InitFrame> frames = recording.frames();
  frames[10].imu.clear();
  const vio::InitResult start =
      vio::initialize(frames, test::start_camera(), {}, 9.81, calibrated());
  EXPECT_EQ(start.status, InitStatus::too_few_frames);
  EXPECT_NE(start.detail.find("inertial"), std::string::npos);
}

TEST(Initializer, RejectsAWrongGravityMagnitude) {
  const StartRecording recording = shaken({.seed = 2});
  const vio::InitResult start =
      vio::initialize(recording.frames(), test::start_camera(),
                      imu::Noise{1.7e-4, 2e-3, 2e-5, 3e-4}, 8.0, calibrated());
  EXPECT_NE(start.status, InitStatus::success);
}

TEST(Initializer, FramesBeforeTheSpanGetPropagatedStates) {
  const StartRecording recording = shaken({.seed = 4, .frames = 50});
  InitConfig config = calibrated();
  config.max_window_s = 1.22;
  const vio::InitResult start = recording.start(config);
  ASSERT_EQ(start.status, InitStatus::success) << start.detail;
  EXPECT_EQ(start.first, 25U);
  ASSERT_EQ(start.states.size(), 50U);
  EXPECT_LT((start.states[0].v_body - recording.truth(0).v_body).norm(), 0.2);
}

TEST(Initializer, StatusNamesAreUnique) {
  std::set<std::string_view> names;
  for (int s = 0; s <= static_cast<int>(InitStatus::scale_uncertain); ++s) {
    names.insert(to_string(static_cast<InitStatus>(s)));
  }
  EXPECT_EQ(names.size(), static_cast<std::size_t>(InitStatus::scale_uncertain) + 1);
}

TEST(GyroBiasFromRays, NeedsNeitherDepthNorTranslation) {
  const StartScene scene{.seed = 7, .pixel_noise = 0.0, .noise = {0.0, 0.0, 0.0, 0.0}};
  const StartRecording recording = shaken(scene);
  vio::StartProblem problem = vio::make_start_problem(recording.frames(), 0, 10);
  problem.T_body_camera = test::start_T_body_camera();
  const vio::GyroBias found = vio::find_gyro_bias(problem, {});
  EXPECT_LT((found.bias - scene.gyro_bias).norm(), 1e-4);  // error of the midpoint rule
}

TEST(MinimizeOnSphere, FindsTheGlobalMinimum) {
  Random random(8);
  for (int n = 0; n < 50; ++n) {
    Eigen::Matrix3d A;
    A << test::random_vector(random, 1.0), test::random_vector(random, 1.0),
        test::random_vector(random, 1.0);
    const Eigen::Matrix3d S = A * A.transpose();
    const Vector3d s = test::random_vector(random, 20.0);
    const auto cost = [&](const Vector3d& x) { return x.dot(S * x) + 2.0 * s.dot(x); };
    const Vector3d best = vio::minimize_on_sphere(S, s, 9.81);
    EXPECT_NEAR(best.norm(), 9.81, 1e-9);
    for (int k = 0; k < 200; ++k) {
      const Vector3d other = 9.81 * test::normal_vector(random, 1.0).normalized();
      EXPECT_LE(cost(best), cost(other) + 1e-9);
    }
  }
}

}  // namespace
}  // namespace apvi
