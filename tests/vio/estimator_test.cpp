// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/vio/estimator.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <memory>
#include <numbers>
#include <vector>

#include "apvi/geometry/so3.hpp"
#include "support/swim.hpp"

namespace apvi {
namespace {

using test::Swim;
using test::SwimOptions;
using vio::GraphKind;
using vio::Status;

vio::Config config_for(GraphKind graph) {
  vio::Config config;
  config.graph = graph;
  config.vision.pixel_sigma = 0.5 * std::numbers::sqrt2;  // a residual has the noise of two corners
  config.vision.information_short = 1.0;  // simulated corners are as good in their first frame
  config.window.max_solve_s = 1e3;
  return config;
}

// The truth with the error that its covariance says, as another estimator would give it.
vio::Aid aid_from(const imu::NavState& truth, Random& random) {
  vio::Aid aid;
  imu::NavVector sigma;
  sigma << 0.01, 0.01, 1e-4, 1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02, 0.01, 0.01, 0.01, 0.03, 0.03, 0.03;
  imu::NavVector error;
  for (int i = 0; i < imu::kNavSize; ++i) error[i] = random.normal(0.0, sigma[i]);
  aid.state = imu::boxplus(truth, error);
  aid.covariance = sigma.cwiseAbs2().asDiagonal();
  return aid;
}

struct Errors {
  double position_m = 0.0;
  double rotation = 0.0;
};

Errors errors(const vio::Result& result, const imu::NavState& truth) {
  return {(result.state.p_world - truth.p_world).norm(),
          so3::angle_between(result.state.R_world_body, truth.R_world_body)};
}

// Feeds a swim to an estimator, frame by frame.
class Drive {
 public:
  Drive(const SwimOptions& options, const vio::Config& config)
      : swim(options), random_(options.seed + 100), estimator(config, Swim::rig()) {}

  vio::Result step(int k, bool visible = true, bool with_aid = false) {
    for (const ImuSample& sample : swim.imu_until(k)) estimator.add(sample);
    if (k % 4 == 0) estimator.add(swim.ping(swim.frame_stamp(k) - Duration::from_seconds(0.03)));
    estimator.add(swim.depth(swim.frame_stamp(k) - Duration::from_seconds(0.01)));
    std::optional<vio::Aid> aid;
    if (k == 0 || with_aid) aid = aid_from(swim.truth(k), random_);
    return estimator.process(swim.frame(k, visible), aid);
  }

  Swim swim;

 private:
  Random random_;

 public:
  vio::Estimator estimator;
};

TEST(Estimator, WithAnAidTheFirstFrameHasAPose) {
  Drive drive({}, config_for(GraphKind::paper));
  const vio::Result first = drive.step(0);
  EXPECT_EQ(first.status, Status::started);
  EXPECT_LT(errors(first, drive.swim.truth(0)).position_m, 0.01);
}

TEST(Estimator, CameraAndImuDriftLessThanTwoPercentOfThePath) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    Drive drive({.seed = seed}, config_for(GraphKind::paper));
    vio::Result last;
    double path = 0.0;
    for (int k = 0; k < drive.swim.frames(); ++k) {
      last = drive.step(k);
      ASSERT_TRUE(last.has_state()) << seed << ", frame " << k << ": " << last.detail;
      if (k > 0) path += (drive.swim.truth(k).p_world - drive.swim.truth(k - 1).p_world).norm();
    }
    const Errors e = errors(last, drive.swim.truth(drive.swim.frames() - 1));
    EXPECT_LT(e.position_m, 0.02 * path) << seed << " over " << path << " m";
    EXPECT_LT(e.rotation, 0.03) << seed;
    EXPECT_NEAR((last.state.gyro_bias - SwimOptions{}.gyro_bias).norm(), 0.0, 0.002) << seed;
  }
}

TEST(Estimator, WindowKeepsScaleThroughATenSecondBlackout) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    Drive drive({.seed = seed}, config_for(GraphKind::tight));
    for (int k = 0; k < drive.swim.frames(); ++k) {
      const bool visible = k < 80 || k >= 280;
      const vio::Result result = drive.step(k, visible);
      ASSERT_TRUE(result.has_state()) << seed << ", frame " << k << ": " << result.detail;
      EXPECT_LT(errors(result, drive.swim.truth(k)).position_m, 0.12) << seed << ", frame " << k;
      if (k == 270) {
        EXPECT_EQ(result.status, Status::blind);
      } else if (k == 300) {
        EXPECT_GT(result.landmarks, 20) << "one second after the images are back";
      }
    }
  }
}

TEST(Estimator, TheNewestPoseIsAsUncertainAsItSays) {
  double nees = 0.0;
  int count = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Drive drive({.seed = seed}, config_for(GraphKind::tight));
    for (int k = 0; k < 200; ++k) {
      const vio::Result result = drive.step(k);
      if (k < 40 || k % 20 != 0) continue;
      const imu::NavState truth = drive.swim.truth(k);
      Eigen::Matrix<double, 6, 1> error;
      error << so3::log(result.state.R_world_body.conjugate() * truth.R_world_body),
          truth.p_world - result.state.p_world;
      nees += error.dot(result.information * error);
      ++count;
    }
  }
  // Ten independent runs of six degrees of freedom: chi square with 60 of them, 99.9 % between 30.3
  // and 99.6; times within a run are correlated, so the runs alone count.
  EXPECT_GT(nees / count, 30.3 / 10.0);
  EXPECT_LT(nees / count, 99.6 / 10.0);
}

TEST(Estimator, BothMarginalizationsGiveTheSamePath) {
  vio::Config config = config_for(GraphKind::paper);
  Drive schur({}, config);
  config.window.square_root = true;
  Drive root({}, config);
  for (int k = 0; k < 120; ++k) {
    const vio::Result a = schur.step(k);
    const vio::Result b = root.step(k);
    ASSERT_NEAR((a.state.p_world - b.state.p_world).norm(), 0.0, 2e-3) << "frame " << k;
  }
}

TEST(Estimator, AQuarterOfThePointsMayMoveOnTheirOwn) {
  Drive drive({.seed = 2, .outliers = 0.25}, config_for(GraphKind::tight));
  for (int k = 0; k < 200; ++k) {
    const vio::Result result = drive.step(k);
    ASSERT_TRUE(result.has_state()) << "frame " << k << ": " << result.detail;
    EXPECT_LT(errors(result, drive.swim.truth(k)).position_m, 0.15) << "frame " << k;
  }
}

// Landmarks and frames lie wherever the heap has room.
TEST(Estimator, WhereTheHeapPutsTheWindowChangesNoBit) {
  Drive one({}, config_for(GraphKind::tight));
  Drive other({}, config_for(GraphKind::tight));
  Random random(5);
  std::vector<std::unique_ptr<char[]>> litter(4096);
  for (int k = 0; k < 100; ++k) {
    const vio::Result a = one.step(k);
    for (auto& piece : litter) {
      if (random.uniform(0.0, 1.0) < 0.5) continue;
      piece = std::make_unique<char[]>(static_cast<std::size_t>(random.uniform(16.0, 512.0)));
    }
    const vio::Result b = other.step(k);
    ASSERT_EQ(a.state.p_world, b.state.p_world) << "frame " << k;
    ASSERT_EQ(a.state.v_body, b.state.v_body) << "frame " << k;
  }
}

TEST(Estimator, AFrozenWindowLeansOnTheAidAndNeverBecomesCertainty) {
  Drive drive({.seed = 3}, config_for(GraphKind::paper));
  for (int k = 0; k < 80; ++k) drive.step(k);
  drive.estimator.freeze();
  std::vector<vio::FrameState> held;
  for (const auto& frame : drive.estimator.window().frames) held.push_back(frame->state);
  for (int k = 80; k < 200; ++k) {
    const vio::Result result = drive.step(k, k >= 180, true);
    ASSERT_EQ(result.status, Status::frozen) << "frame " << k;
    EXPECT_LT(errors(result, drive.swim.truth(k)).position_m, 0.05) << "frame " << k;
  }
  const auto& frames = drive.estimator.window().frames;
  for (std::size_t i = 0; i < held.size(); ++i) {
    EXPECT_EQ(frames[i]->state.pose, held[i].pose) << "held frame " << i;
    EXPECT_EQ(frames[i]->state.motion, held[i].motion) << "held frame " << i;
  }
  drive.estimator.release();
  for (const auto& frame : frames) EXPECT_FALSE(frame->frozen);
  ASSERT_TRUE(drive.estimator.window().prior);
  for (const auto& kept : drive.estimator.window().prior->kept) {
    EXPECT_EQ(kept.block.data == frames.front()->state.pose.data() ||
                  kept.block.data == frames.front()->state.motion.data(),
              true)
        << "the prior knows frames since the freeze only";
  }
  for (int k = 200; k < 240; ++k) {
    const vio::Result result = drive.step(k);
    ASSERT_EQ(result.status, Status::tracking) << "frame " << k << ": " << result.detail;
    EXPECT_LT(errors(result, drive.swim.truth(k)).position_m, 0.1) << "frame " << k;
  }
}

TEST(Estimator, WhatMovesWhileVisionIsNotBelievedMovesNoWindowWithADvl) {
  double drift[2] = {};
  for (const bool believed : {true, false}) {
    vio::Config config = config_for(GraphKind::tight);
    config.tight.believed_tracks = 1000;
    Drive drive({.seed = 3}, config);
    for (int k = 0; k < 80; ++k) drive.step(k);
    if (!believed) drive.estimator.freeze();
    for (int k = 80; k < 160; ++k) {
      drive.swim.set_current({0.0, 0.25, 0.0});
      const vio::Result result = drive.step(k);
      ASSERT_TRUE(result.has_state()) << result.detail;
      double& worst = drift[believed ? 1 : 0];
      worst = std::max(worst, errors(result, drive.swim.truth(k)).position_m);
    }
    EXPECT_EQ(drive.estimator.frozen(), false);
    drive.swim.set_current({0.0, 0.0, 0.0});
    drive.estimator.release();
    for (const auto& frame : drive.estimator.window().frames) EXPECT_FALSE(frame->doubtful);
  }
  EXPECT_LT(drift[0], 0.06);
  EXPECT_LT(drift[0], 0.5 * drift[1]);
}

TEST(Estimator, TracksThatEndInDoubtAreForgottenAndTheOthersCountAgain) {
  vio::Config config = config_for(GraphKind::tight);
  config.tight.believed_tracks = 1000;
  Drive drive({.seed = 5}, config);
  for (int k = 0; k < 80; ++k) drive.step(k);
  drive.estimator.freeze();
  vio::Result result;
  for (int k = 80; k < 200; ++k) result = drive.step(k);
  EXPECT_EQ(result.landmarks, 0);
  drive.estimator.release();
  result = drive.step(200);
  EXPECT_GT(result.landmarks, 20);
  EXPECT_LT(errors(result, drive.swim.truth(200)).position_m, 0.15);
}

TEST(Estimator, AFrameThatFollowsManyCornersCountsAlthoughVisionHasFailed) {
  vio::Config config = config_for(GraphKind::tight);
  config.tight.believed_tracks = 20;
  Drive drive({.seed = 5}, config);
  for (int k = 0; k < 80; ++k) drive.step(k);
  drive.estimator.freeze();
  for (int k = 80; k < 200; ++k) EXPECT_GT(drive.step(k).landmarks, 10) << "frame " << k;
}

// Frames of the window with pings in the graph, by when they were [s after the first frame].
std::vector<double> with_pings(const Drive& drive) {
  std::vector<double> found;
  for (const auto& frame : drive.estimator.window().frames) {
    if (!frame->pings.empty()) {
      found.push_back(seconds_between(drive.swim.frame_stamp(0), frame->stamp));
    }
  }
  return found;
}

TEST(Estimator, ThePapersGraphTakesPingsInForAWhileAfterAStartAndWhileFrozen) {
  Drive drive({}, config_for(GraphKind::paper));
  for (int k = 0; k < 40; ++k) drive.step(k);
  EXPECT_GT(with_pings(drive).size(), 2U);
  for (int k = 40; k < 240; ++k) drive.step(k);
  for (const double t : with_pings(drive)) EXPECT_LT(t, 3.5);
  drive.estimator.freeze();
  for (int k = 240; k < 260; ++k) drive.step(k, false, true);
  drive.estimator.release();
  EXPECT_FALSE(with_pings(drive).empty());
}

TEST(Estimator, AStartInTheDarkStaysWithTheAidUntilThereIsSomethingToSee) {
  Drive drive({}, config_for(GraphKind::paper));
  for (int k = 0; k < 60; ++k) {
    const vio::Result result = drive.step(k, false, true);
    EXPECT_EQ(result.status, Status::started) << k;
    EXPECT_LT(errors(result, drive.swim.truth(k)).position_m, 0.02) << k;
  }
  for (int k = 60; k < 80; ++k) drive.step(k, true, true);
  EXPECT_EQ(drive.step(80).status, Status::tracking);
}

TEST(Estimator, AShockOfTheInertialSensorIsBridged) {
  Drive drive({.seed = 4}, config_for(GraphKind::tight));
  for (int k = 0; k < 100; ++k) {
    if (k == 60) {
      for (ImuSample sample : drive.swim.imu_until(k + 2)) {
        sample.accel.x() += 200.0;
        drive.estimator.add(sample);
      }
    }
    const vio::Result result = drive.step(k);
    if (k >= 60 && k <= 62) continue;  // waits for inertial data
    ASSERT_TRUE(result.has_state()) << k << ": " << result.detail;
    EXPECT_LT(errors(result, drive.swim.truth(k)).position_m, 0.06) << k;
  }
}

TEST(Estimator, AWindowReleasedAfterASingleFrameGoesOn) {
  for (int frozen_for = 1; frozen_for <= 4; ++frozen_for) {
    Drive drive({.seed = 3}, config_for(GraphKind::paper));
    for (int k = 0; k < 40; ++k) drive.step(k);
    drive.estimator.freeze();
    for (int k = 40; k < 40 + frozen_for; ++k) drive.step(k, true, true);
    drive.estimator.release();
    for (int k = 40 + frozen_for; k < 60; ++k) EXPECT_TRUE(drive.step(k).has_state()) << k;
  }
}

TEST(Estimator, ReleasingWithoutASingleFrameSinceStartsAnew) {
  Drive drive({}, config_for(GraphKind::paper));
  for (int k = 0; k < 20; ++k) drive.step(k);
  drive.estimator.freeze();
  drive.estimator.release();
  EXPECT_FALSE(drive.estimator.started());
}

TEST(Estimator, WaitsForInertialDataAndSaysSo) {
  Swim swim({});
  vio::Estimator estimator(config_for(GraphKind::paper), Swim::rig());
  const vio::Result result = estimator.process(swim.frame(0), std::nullopt);
  EXPECT_EQ(result.status, Status::waiting);
  EXPECT_EQ(result.detail, "inertial data");
}

TEST(Estimator, AStampThatGoesBackwardChangesNothing) {
  Drive drive({}, config_for(GraphKind::paper));
  for (int k = 0; k < 10; ++k) drive.step(k);
  const vio::FrameState before = drive.estimator.window().newest().state;
  const vio::Result result = drive.estimator.process(drive.swim.frame(5), std::nullopt);
  EXPECT_EQ(result.status, Status::blind);
  EXPECT_EQ(drive.estimator.window().newest().state.pose, before.pose);
}

TEST(Estimator, AGapInTheInertialDataIsALossAndTheNextFrameStartsAnew) {
  Drive drive({}, config_for(GraphKind::paper));
  for (int k = 0; k < 30; ++k) drive.step(k);
  drive.estimator.reset();
  EXPECT_FALSE(drive.estimator.started());
  const vio::Result again = drive.step(31, true, true);
  EXPECT_EQ(again.status, Status::started);
}

TEST(Estimator, DivergenceIsNoticedAndNamed) {
  vio::Config config = config_for(GraphKind::paper);
  config.health.max_gyro_bias = 0.01;  // less than the true one
  Drive drive({}, config);
  vio::Result result;
  int k = 0;
  do result = drive.step(k++);
  while (result.has_state() && k < 100);
  EXPECT_EQ(result.status, Status::lost);
  EXPECT_NE(result.detail.find("gyro bias"), std::string::npos) << result.detail;
  EXPECT_FALSE(drive.estimator.started());
}

}  // namespace
}  // namespace apvi
