// SPDX-License-Identifier: BSD-3-Clause
#include "vio/estimator.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <memory>
#include <numbers>
#include <set>
#include <vector>

#include "apvi/geometry/so3.hpp"
#include "support/simulated_dive.hpp"

namespace apvi {
namespace {

using test::SimulatedDive;
using test::SimulatedDiveOptions;
using vio::GraphKind;
using vio::Status;

vio::Config config_for(GraphKind graph) {
  vio::Config config;
  config.graph = graph;
  config.vision.pixel_sigma = 0.5 * std::numbers::sqrt2;  // a residual has the noise of two corners
  config.vision.short_track_weight =
      1.0;  // simulated corners are equally accurate in their first frame
  config.window.max_solve_s = 1e3;
  return config;
}

// A state prior with an error drawn from its covariance.
vio::StatePrior prior_from(const imu::NavState& truth, Random& random) {
  vio::StatePrior prior;
  imu::NavVector sigma;
  sigma << 0.01, 0.01, 1e-4, 1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02, 0.01, 0.01, 0.01, 0.03, 0.03, 0.03;
  imu::NavVector error;
  for (int i = 0; i < imu::kNavSize; ++i) error[i] = random.normal(0.0, sigma[i]);
  prior.state = imu::boxplus(truth, error);
  prior.covariance = sigma.cwiseAbs2().asDiagonal();
  return prior;
}

struct Errors {
  double position_m = 0.0;
  double rotation = 0.0;
};

Errors errors(const vio::Result& result, const imu::NavState& truth) {
  return {(result.state.p_world - truth.p_world).norm(),
          so3::angle_between(result.state.R_world_body, truth.R_world_body)};
}

// Feeds a simulated dive to an estimator, frame by frame.
class EstimatorRun {
 public:
  EstimatorRun(const SimulatedDiveOptions& options, const vio::Config& config)
      : dive(options), random_(options.seed + 100), estimator(config, SimulatedDive::rig()) {}

  vio::Result step(int k, bool visible = true, bool with_prior = false) {
    for (const ImuSample& sample : dive.imu_until(k)) estimator.add(sample);
    if (k % 4 == 0) estimator.add(dive.ping(dive.frame_stamp(k) - Duration::from_seconds(0.03)));
    estimator.add(dive.depth(dive.frame_stamp(k) - Duration::from_seconds(0.01)));
    std::optional<vio::StatePrior> prior;
    if (k == 0 || with_prior) prior = prior_from(dive.truth(k), random_);
    return estimator.process(dive.frame(k, visible), prior);
  }

  SimulatedDive dive;

 private:
  Random random_;

 public:
  vio::Estimator estimator;
};

TEST(Estimator, InitializesAtTheFirstFrameWithAStatePrior) {
  EstimatorRun run({}, config_for(GraphKind::paper));
  const vio::Result first = run.step(0);
  EXPECT_EQ(first.status, Status::started);
  EXPECT_LT(errors(first, run.dive.truth(0)).position_m, 0.01);
}

TEST(Estimator, CameraImuDriftIsBelowTwoPercent) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    EstimatorRun run({.seed = seed}, config_for(GraphKind::paper));
    vio::Result last;
    double path = 0.0;
    for (int k = 0; k < run.dive.frames(); ++k) {
      last = run.step(k);
      ASSERT_TRUE(last.has_state()) << seed << ", frame " << k << ": " << last.detail;
      if (k > 0) path += (run.dive.truth(k).p_world - run.dive.truth(k - 1).p_world).norm();
    }
    const Errors e = errors(last, run.dive.truth(run.dive.frames() - 1));
    EXPECT_LT(e.position_m, 0.02 * path) << seed << " over " << path << " m";
    EXPECT_LT(e.rotation, 0.03) << seed;
    EXPECT_NEAR((last.state.gyro_bias - SimulatedDiveOptions{}.gyro_bias).norm(), 0.0, 0.002)
        << seed;
  }
}

TEST(Estimator, TightWindowSurvivesATenSecondBlackout) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    EstimatorRun run({.seed = seed}, config_for(GraphKind::tight));
    for (int k = 0; k < run.dive.frames(); ++k) {
      const bool visible = k < 80 || k >= 280;
      const vio::Result result = run.step(k, visible);
      ASSERT_TRUE(result.has_state()) << seed << ", frame " << k << ": " << result.detail;
      EXPECT_LT(errors(result, run.dive.truth(k)).position_m, 0.12) << seed << ", frame " << k;
      if (k == 270) {
        EXPECT_EQ(result.status, Status::blind);
      } else if (k == 300) {
        EXPECT_GT(result.landmarks, 20) << "one second after the images return";
      }
    }
  }
}

TEST(Estimator, NewestPoseIsConsistent) {
  double nees = 0.0;
  int count = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    EstimatorRun run({.seed = seed}, config_for(GraphKind::tight));
    for (int k = 0; k < 200; ++k) {
      const vio::Result result = run.step(k);
      if (k < 40 || k % 20 != 0) continue;
      const imu::NavState truth = run.dive.truth(k);
      Eigen::Matrix<double, 6, 1> error;
      error << so3::log(result.state.R_world_body.conjugate() * truth.R_world_body),
          truth.p_world - result.state.p_world;
      nees += error.dot(result.information * error);
      ++count;
    }
  }
  // Ten independent runs of six degrees of freedom: chi-square with 60 degrees of freedom, 99.9 %
  // between 30.3 and 99.6; samples within a run are correlated.
  EXPECT_GT(nees / count, 30.3 / 10.0);
  EXPECT_LT(nees / count, 99.6 / 10.0);
}

TEST(Estimator, BothMarginalizationMethodsAgree) {
  vio::Config config = config_for(GraphKind::paper);
  EstimatorRun schur({}, config);
  config.window.square_root_marginalization = true;
  EstimatorRun root({}, config);
  for (int k = 0; k < 120; ++k) {
    const vio::Result a = schur.step(k);
    const vio::Result b = root.step(k);
    ASSERT_NEAR((a.state.p_world - b.state.p_world).norm(), 0.0, 2e-3) << "frame " << k;
  }
}

TEST(Estimator, RobustToAQuarterOfMovingPoints) {
  EstimatorRun run({.seed = 2, .outliers = 0.25}, config_for(GraphKind::tight));
  for (int k = 0; k < 200; ++k) {
    const vio::Result result = run.step(k);
    ASSERT_TRUE(result.has_state()) << "frame " << k << ": " << result.detail;
    EXPECT_LT(errors(result, run.dive.truth(k)).position_m, 0.15) << "frame " << k;
  }
}

// Addresses of landmarks and frames depend on the heap.
TEST(Estimator, ResultsDoNotDependOnHeapAddresses) {
  EstimatorRun one({}, config_for(GraphKind::tight));
  EstimatorRun other({}, config_for(GraphKind::tight));
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

void expect_accurate(EstimatorRun& run, int begin, int end) {
  for (int k = begin; k < end; ++k) {
    const vio::Result result = run.step(k);
    ASSERT_EQ(result.status, Status::tracking) << "frame " << k << ": " << result.detail;
    EXPECT_LT(errors(result, run.dive.truth(k)).position_m, 0.1) << "frame " << k;
  }
}

TEST(Estimator, FrozenWindowFollowsTheStatePriorAndLeavesNoPrior) {
  EstimatorRun run({.seed = 3}, config_for(GraphKind::paper));
  for (int k = 0; k < 80; ++k) run.step(k);
  run.estimator.freeze();
  std::vector<vio::FrameState> held;
  for (const auto& frame : run.estimator.window().frames) held.push_back(frame->state);
  for (int k = 80; k < 200; ++k) {
    const vio::Result result = run.step(k, k >= 180, true);
    ASSERT_EQ(result.status, Status::frozen) << "frame " << k;
    EXPECT_LT(errors(result, run.dive.truth(k)).position_m, 0.05) << "frame " << k;
  }
  const auto& frames = run.estimator.window().frames;
  for (std::size_t i = 0; i < held.size(); ++i) {
    EXPECT_EQ(frames[i]->state.pose, held[i].pose) << "held frame " << i;
    EXPECT_EQ(frames[i]->state.motion, held[i].motion) << "held frame " << i;
  }
  run.estimator.release();
  for (const auto& frame : frames) EXPECT_FALSE(frame->frozen);
  ASSERT_TRUE(run.estimator.window().prior);
  const vio::Calibration& c = run.estimator.window().calibration;
  const std::set<const double*> expected{frames.front()->state.pose.data(),
                                         frames.front()->state.motion.data(),
                                         c.T_body_camera.front().data(),
                                         c.lenses.front().data(),
                                         &c.camera_time_offset_s,
                                         c.T_body_dvl.data(),
                                         &c.dvl_log_scale};
  for (const auto& kept : run.estimator.window().prior->kept) {
    EXPECT_TRUE(expected.contains(kept.block.data))
        << "the prior contains the first frame after the freeze and the calibration only";
  }
  expect_accurate(run, 200, 240);
}

TEST(Estimator, UnfreezeKeepsTheFrozenFramesAndTheirPrior) {
  vio::Config config = config_for(GraphKind::paper);
  config.window.keyframes = 30;  // more than there are
  EstimatorRun run({.seed = 3}, config);
  for (int k = 0; k < 40; ++k) run.step(k);
  const auto& frames = run.estimator.window().frames;
  const std::size_t held = frames.size();
  const auto prior = run.estimator.window().prior;
  const Stamp oldest = frames.front()->stamp;
  run.estimator.freeze();
  run.step(40, true, true);
  EXPECT_FALSE(run.estimator.window().prior);
  run.estimator.unfreeze();
  EXPECT_EQ(run.estimator.window().prior, prior);
  EXPECT_EQ(frames.front()->stamp, oldest);
  EXPECT_GE(frames.size(), held);
  for (const auto& frame : frames) EXPECT_FALSE(frame->frozen || frame->state_prior);
  expect_accurate(run, 41, 120);
}

TEST(Estimator, UnfreezeContinuesAfterALongFailure) {
  vio::Config config = config_for(GraphKind::paper);
  EstimatorRun run({.seed = 3}, config);
  for (int k = 0; k < 80; ++k) run.step(k);
  run.estimator.freeze();
  for (int k = 80; k < 200; ++k) run.step(k, k >= 180, true);
  run.estimator.unfreeze();
  EXPECT_LE(run.estimator.window().frames.size(),
            static_cast<std::size_t>(config.window.keyframes));
  expect_accurate(run, 200, 260);
}

TEST(Estimator, UnfreezeWithoutNewFramesContinues) {
  EstimatorRun run({}, config_for(GraphKind::paper));
  for (int k = 0; k < 20; ++k) run.step(k);
  run.estimator.freeze();
  run.estimator.unfreeze();
  EXPECT_EQ(run.step(20).status, Status::tracking);
}

TEST(Estimator, PaperGraphWithoutAidingNeverUsesPings) {
  vio::Config config = config_for(GraphKind::paper);
  config.initialization.dvl_aiding_s = 0.0;
  EstimatorRun run({}, config);
  for (int k = 0; k < 40; ++k) run.step(k);
  run.estimator.freeze();
  for (int k = 40; k < 60; ++k) run.step(k, false, true);
  for (const auto& frame : run.estimator.window().frames) EXPECT_TRUE(frame->pings.empty());
}

TEST(Estimator, MovingSceneDuringVisionFailureDoesNotMoveATightWindow) {
  double drift[2] = {};
  for (const bool trusted : {true, false}) {
    vio::Config config = config_for(GraphKind::tight);
    config.tight.recovery_min_tracks = 1000;
    EstimatorRun run({.seed = 3}, config);
    for (int k = 0; k < 80; ++k) run.step(k);
    if (!trusted) run.estimator.freeze();
    for (int k = 80; k < 160; ++k) {
      run.dive.set_current({0.0, 0.25, 0.0});
      const vio::Result result = run.step(k);
      ASSERT_TRUE(result.has_state()) << result.detail;
      double& worst = drift[trusted ? 1 : 0];
      worst = std::max(worst, errors(result, run.dive.truth(k)).position_m);
    }
    EXPECT_EQ(run.estimator.frozen(), false);
    run.dive.set_current({0.0, 0.0, 0.0});
    run.estimator.release();
    for (const auto& frame : run.estimator.window().frames) EXPECT_FALSE(frame->vision_excluded);
  }
  EXPECT_LT(drift[0], 0.06);
  EXPECT_LT(drift[0], 0.5 * drift[1]);
}

TEST(Estimator, ReleaseDropsTracksLostDuringTheFailureAndKeepsTheOthers) {
  vio::Config config = config_for(GraphKind::tight);
  config.tight.recovery_min_tracks = 1000;
  EstimatorRun run({.seed = 5}, config);
  for (int k = 0; k < 80; ++k) run.step(k);
  run.estimator.freeze();
  vio::Result result;
  for (int k = 80; k < 200; ++k) result = run.step(k);
  EXPECT_EQ(result.landmarks, 0);
  run.estimator.release();
  result = run.step(200);
  EXPECT_GT(result.landmarks, 20);
  EXPECT_LT(errors(result, run.dive.truth(200)).position_m, 0.15);
}

TEST(Estimator, FramesWithManyTracksAreUsedDuringVisionFailure) {
  vio::Config config = config_for(GraphKind::tight);
  config.tight.recovery_min_tracks = 20;
  EstimatorRun run({.seed = 5}, config);
  for (int k = 0; k < 80; ++k) run.step(k);
  run.estimator.freeze();
  for (int k = 80; k < 200; ++k) EXPECT_GT(run.step(k).landmarks, 10) << "frame " << k;
}

// Times of the frames in the window with pings in the graph [s after the first frame].
std::vector<double> with_pings(const EstimatorRun& run) {
  std::vector<double> found;
  for (const auto& frame : run.estimator.window().frames) {
    if (!frame->pings.empty()) {
      found.push_back(seconds_between(run.dive.frame_stamp(0), frame->stamp));
    }
  }
  return found;
}

TEST(Estimator, PaperGraphUsesPingsAfterInitializationAndWhileFrozen) {
  EstimatorRun run({}, config_for(GraphKind::paper));
  for (int k = 0; k < 40; ++k) run.step(k);
  EXPECT_GT(with_pings(run).size(), 2U);
  for (int k = 40; k < 240; ++k) run.step(k);
  for (const double t : with_pings(run)) EXPECT_LT(t, 3.5);
  run.estimator.freeze();
  for (int k = 240; k < 260; ++k) run.step(k, false, true);
  run.estimator.release();
  EXPECT_FALSE(with_pings(run).empty());
}

TEST(Estimator, FollowsTheStatePriorUntilThereAreLandmarks) {
  EstimatorRun run({}, config_for(GraphKind::paper));
  for (int k = 0; k < 60; ++k) {
    const vio::Result result = run.step(k, false, true);
    EXPECT_EQ(result.status, Status::started) << k;
    EXPECT_LT(errors(result, run.dive.truth(k)).position_m, 0.02) << k;
  }
  for (int k = 60; k < 80; ++k) run.step(k, true, true);
  EXPECT_EQ(run.step(80).status, Status::tracking);
}

TEST(Estimator, BridgesSaturatedInertialSamples) {
  EstimatorRun run({.seed = 4}, config_for(GraphKind::tight));
  for (int k = 0; k < 100; ++k) {
    if (k == 60) {
      for (ImuSample sample : run.dive.imu_until(k + 2)) {
        sample.accel.x() += 200.0;
        run.estimator.add(sample);
      }
    }
    const vio::Result result = run.step(k);
    if (k >= 60 && k <= 62) continue;  // waiting for inertial data
    ASSERT_TRUE(result.has_state()) << k << ": " << result.detail;
    EXPECT_LT(errors(result, run.dive.truth(k)).position_m, 0.06) << k;
  }
}

TEST(Estimator, ContinuesAfterReleaseWithinAFewFrames) {
  for (int frozen_for = 1; frozen_for <= 4; ++frozen_for) {
    EstimatorRun run({.seed = 3}, config_for(GraphKind::paper));
    for (int k = 0; k < 40; ++k) run.step(k);
    run.estimator.freeze();
    for (int k = 40; k < 40 + frozen_for; ++k) run.step(k, true, true);
    run.estimator.release();
    for (int k = 40 + frozen_for; k < 60; ++k) EXPECT_TRUE(run.step(k).has_state()) << k;
  }
}

TEST(Estimator, ReleaseWithoutNewFramesResets) {
  EstimatorRun run({}, config_for(GraphKind::paper));
  for (int k = 0; k < 20; ++k) run.step(k);
  run.estimator.freeze();
  run.estimator.release();
  EXPECT_FALSE(run.estimator.started());
}

TEST(Estimator, ReportsWaitingForInertialData) {
  SimulatedDive dive({});
  vio::Estimator estimator(config_for(GraphKind::paper), SimulatedDive::rig());
  const vio::Result result = estimator.process(dive.frame(0), std::nullopt);
  EXPECT_EQ(result.status, Status::waiting);
  EXPECT_EQ(result.detail, "inertial data");
}

TEST(Estimator, IgnoresNonIncreasingStamps) {
  EstimatorRun run({}, config_for(GraphKind::paper));
  for (int k = 0; k < 10; ++k) run.step(k);
  const vio::FrameState before = run.estimator.window().newest().state;
  const vio::Result result = run.estimator.process(run.dive.frame(5), std::nullopt);
  EXPECT_EQ(result.status, Status::blind);
  EXPECT_EQ(run.estimator.window().newest().state.pose, before.pose);
}

TEST(Estimator, InertialGapIsALossAndReinitializes) {
  EstimatorRun run({}, config_for(GraphKind::paper));
  for (int k = 0; k < 30; ++k) run.step(k);
  run.estimator.reset();
  EXPECT_FALSE(run.estimator.started());
  const vio::Result again = run.step(31, true, true);
  EXPECT_EQ(again.status, Status::started);
}

TEST(Estimator, ReportsDivergence) {
  vio::Config config = config_for(GraphKind::paper);
  config.health.max_gyro_bias = 0.01;  // below the true bias
  EstimatorRun run({}, config);
  vio::Result result;
  int k = 0;
  do result = run.step(k++);
  while (result.has_state() && k < 100);
  EXPECT_EQ(result.status, Status::lost);
  EXPECT_NE(result.detail.find("gyro bias"), std::string::npos) << result.detail;
  EXPECT_FALSE(run.estimator.started());
}

}  // namespace
}  // namespace apvi
