// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <numbers>
#include <string>

#include "apvi/geometry/so3.hpp"
#include "support/simulated_dive.hpp"
#include "vio/estimator.hpp"

namespace apvi {
namespace {

using test::SimulatedDive;

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kLate_s = 0.04;

// As a user might have measured it: turned by a degree, 2 cm and 1 % off, images late.
Rig wrong_rig() {
  Rig rig = SimulatedDive::rig();
  CameraCalibration& camera = rig.cameras.front();
  camera.T_body_camera.rotation *= so3::exp({0.6 * kDegree, -kDegree, 0.5 * kDegree});
  camera.T_body_camera.translation += Eigen::Vector3d(0.02, -0.01, 0.01);
  CameraModel::Parameters lens = camera.model.parameters();
  lens.fx *= 1.01;
  lens.fy *= 1.01;
  camera.model = CameraModel(lens);
  rig.dvl->T_body_dvl.rotation *= so3::exp({0.0, 0.5 * kDegree, -kDegree});
  return rig;
}

struct Outcome {
  double position_m = 0.0;
  double rotation = 0.0;
  Rig rig;
};

// What is wrong about a rig besides wrong_rig(): the images' scale and delay.
struct Errors {
  Rig rig = wrong_rig();
  double focal = 1.01;
  double late_s = kLate_s;
};

// The dive's frames, with corners by the wrong lens and stamps that are late.
Outcome run(std::uint64_t seed, const vio::CalibrationConfig& calibration,
            const Errors& errors = {}) {
  SimulatedDive dive({.seed = seed, .duration_s = 30.0});
  vio::Config config;
  config.vision.pixel_sigma = 0.5 * std::numbers::sqrt2;
  config.vision.short_track_weight = 1.0;
  config.window.max_solve_s = 1e3;
  config.calibration = calibration;
  vio::Estimator estimator(config, errors.rig);
  vio::Result last;
  int frames = 0;
  for (int k = 0; k + 1 < dive.frames(); ++k, ++frames) {
    for (const ImuSample& sample : dive.imu_until(k + 1)) estimator.add(sample);
    const Stamp stamp = dive.frame_stamp(k);
    if (k % 4 == 0) estimator.add(dive.ping(stamp - Duration::from_seconds(0.03)));
    estimator.add(dive.depth(stamp - Duration::from_seconds(0.01)));
    vio::TrackedFrame tracked = dive.frame(k);
    tracked.stamp = stamp + Duration::from_seconds(errors.late_s);
    for (vio::FeatureObservation& seen : tracked.observations) seen.point /= errors.focal;
    std::optional<vio::StatePrior> prior;
    if (k == 0) prior = vio::StatePrior{dive.truth(0), 1e-3 * imu::NavMatrix::Identity()};
    last = estimator.process(tracked, prior);
  }
  // The pose of the last frame is that at its late stamp.
  const imu::NavState truth = dive.truth(frames - 1);
  const Eigen::Vector3d expected =
      truth.p_world + errors.late_s * (truth.R_world_body * truth.v_body);
  return {(last.state.p_world - expected).norm(),
          so3::angle_between(last.state.R_world_body, truth.R_world_body),
          estimator.calibrated_rig()};
}

TEST(SelfCalibration, FindsTheCalibrationOfAWrongRig) {
  const Outcome fixed = run(2, vio::CalibrationConfig::fixed());
  const Outcome found = run(2, {});
  const Rig truth = SimulatedDive::rig();
  const CameraCalibration& camera = found.rig.cameras.front();
  EXPECT_LT(found.position_m, 0.5 * fixed.position_m);
  EXPECT_NEAR(camera.time_offset_s, kLate_s, 0.002);
  EXPECT_LT(so3::angle_between(camera.T_body_camera.rotation,
                               truth.cameras.front().T_body_camera.rotation),
            0.1 * kDegree);
  EXPECT_NEAR(camera.model.parameters().fx / SimulatedDive::kFocal, 1.0, 0.0015);
  EXPECT_LT(so3::angle_between(found.rig.dvl->T_body_dvl.rotation, truth.dvl->T_body_dvl.rotation),
            0.6 * kDegree);
}

TEST(SelfCalibration, KeepsARigThatIsRight) {
  const Errors none{.rig = SimulatedDive::rig(), .focal = 1.0, .late_s = 0.0};
  const Rig kept = run(2, {}, none).rig;
  vio::CalibrationConfig free;
  free.release_sigmas = 0.0;
  const Rig moved = run(2, free, none).rig;
  const auto turned = [&none](const Rig& rig) {
    return so3::angle_between(rig.dvl->T_body_dvl.rotation, none.rig.dvl->T_body_dvl.rotation);
  };
  EXPECT_LT(turned(kept), 0.02 * kDegree);
  EXPECT_GT(turned(moved), 0.05 * kDegree);
}

}  // namespace
}  // namespace apvi
