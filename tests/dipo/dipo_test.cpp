// SPDX-License-Identifier: BSD-3-Clause
#include "dipo/dipo.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>

#include "apvi/core/error.hpp"
#include "dipo/noise_tracker.hpp"
#include "support/spline_imu.hpp"

namespace apvi::dipo {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

Rig make_test_rig() {
  Rig rig;
  rig.imu = ImuCalibration{.rate_hz = 100.0,
                           .gyro_noise_density = 2e-4,
                           .gyro_random_walk = 1e-6,
                           .accel_noise_density = 2e-3,
                           .accel_random_walk = 1e-5};
  rig.dvl = DvlCalibration{};
  rig.dvl->velocity_noise = 0.005;
  rig.dvl->beams = default_dvl_beams();
  // x forward, y right, z down in a body that is forward, left, up.
  rig.dvl->T_body_dvl = {Quaterniond(Eigen::AngleAxisd(std::acos(-1.0), Vector3d::UnitX())),
                         Vector3d(0.4, 0.1, -0.2)};
  rig.pressure = PressureCalibration{};
  return rig;
}

// A dive along a spline: simulated sensor data of the true vehicle.
struct Dive {
  Rig truth = make_test_rig();
  double duration_s = 60.0;
  double dvl_delay_s = 0.0;
  bool beams = false;
  std::uint64_t seed = 41;
  std::function<void(DvlSample&, double)> disturb_dvl = [](DvlSample&, double) {};
  std::function<void(ImuSample&, double)> disturb_imu = [](ImuSample&, double) {};
  std::function<void(PressureSample&, double)> disturb_pressure = [](PressureSample&, double) {};
  std::function<bool(double)> imu_present = [](double) { return true; };
};

struct Outcome {
  std::optional<Estimate> last;
  std::map<Verdict, int> pings;
  double end_error_m = 0.0;        // of the displacement since the first estimate, heading aligned
  double heading_error_rad = 0.0;  // accumulated since the first estimate
  double largest_step_m = 0.0;
  std::size_t zero_velocity_updates = 0;
};

DvlSample ping_at(const Dive& dive, const Se3Spline& spline, Stamp stamp, Random& random) {
  const Stamp then = stamp - Duration::from_seconds(dive.dvl_delay_s);
  const Motion motion = spline.at(then);
  const SE3& mount = dive.truth.dvl->T_body_dvl;
  const Vector3d v_body = motion.T_world_body.rotation.conjugate() * motion.velocity_world +
                          motion.angular_velocity_body.cross(mount.translation);
  DvlSample ping;
  ping.stamp = stamp;
  ping.valid = true;
  const Vector3d v_dvl = mount.rotation.conjugate() * v_body;
  ping.velocity = v_dvl + test::normal_vector(random, dive.truth.dvl->velocity_noise);
  for (std::size_t i = 0; dive.beams && i < kDvlBeams; ++i) {
    const double noise = random.normal(0.0, dive.truth.dvl->velocity_noise);
    ping.beams[i] = DvlBeam{dive.truth.dvl->beams[i].dot(v_dvl) + noise, 2.0, true};
  }
  return ping;
}

Outcome run_dive(const Dive& dive, const Config& config, const Rig& rig) {
  const Se3Spline spline = test::wavy_spline(dive.seed, dive.duration_s);
  const Vector3d gravity(0.0, 0.0, -9.80665);
  Random random(dive.seed);
  Dipo dipo(config, rig);
  Outcome outcome;
  const double dt = 1.0 / rig.imu->rate_hz;
  std::optional<Vector3d> last_position;
  std::optional<SE3> first_true;
  std::optional<SE3> first_estimate;
  int k = 0;
  for (const ImuSample& clean : test::imu_along(spline, gravity, rig.imu->rate_hz)) {
    const double t = seconds_between(spline.start(), clean.stamp);
    ImuSample sample = clean;
    sample.gyro += test::normal_vector(random, rig.imu->gyro_noise_density / std::sqrt(dt));
    sample.accel += test::normal_vector(random, rig.imu->accel_noise_density / std::sqrt(dt));
    dive.disturb_imu(sample, t);
    if (dive.imu_present(t)) dipo.add(sample);
    if (k % 20 == 7) {
      DvlSample ping = ping_at(dive, spline, clean.stamp, random);
      dive.disturb_dvl(ping, t);
      dipo.add(ping);
    }
    if (k % 10 == 3 && rig.pressure) {
      const double depth =
          10.0 - spline.at(clean.stamp).T_world_body.translation.z() + random.normal(0.0, 0.01);
      PressureSample pressure{clean.stamp,
                              rig.pressure->atmospheric_pressure_pa +
                                  depth * rig.pressure->water_density * rig.pressure->gravity};
      dive.disturb_pressure(pressure, t);
      dipo.add(pressure);
    }
    ++k;
    for (const Report& report : dipo.take_dvl_reports()) ++outcome.pings[report.verdict];
    outcome.last = dipo.latest();
    if (!outcome.last) continue;
    const imu::NavState& nav = outcome.last->state.nav;
    EXPECT_TRUE(nav.p_world.allFinite() && nav.v_body.allFinite()) << "at " << t << " s";
    if (last_position) {
      outcome.largest_step_m =
          std::max(outcome.largest_step_m, (nav.p_world - *last_position).norm());
    }
    last_position = nav.p_world;
    if (!first_true) {
      first_true = spline.at(outcome.last->stamp).T_world_body;
      first_estimate = nav.pose();
    }
  }
  if (outcome.last) {
    // Heading and origin are arbitrary in each run; everything else must agree.
    const double turn = so3::yaw(first_true->rotation) - so3::yaw(first_estimate->rotation);
    const Quaterniond heading(Eigen::AngleAxisd(turn, Vector3d::UnitZ()));
    const Vector3d made = heading * (outcome.last->state.nav.p_world - first_estimate->translation);
    const Vector3d truly =
        spline.at(outcome.last->stamp).T_world_body.translation - first_true->translation;
    outcome.end_error_m = (made - truly).norm();
    const SE3 truth = spline.at(outcome.last->stamp).T_world_body;
    outcome.heading_error_rad = std::remainder(
        so3::yaw(outcome.last->state.nav.R_world_body) + turn - so3::yaw(truth.rotation),
        2.0 * std::acos(-1.0));
  }
  outcome.zero_velocity_updates = dipo.zero_velocity_updates();
  return outcome;
}

TEST(Dipo, TracksAOneMinuteDive) {
  const Outcome outcome = run_dive({}, {}, make_test_rig());
  ASSERT_TRUE(outcome.last);
  EXPECT_LT(outcome.end_error_m, 0.3);
  EXPECT_LT(outcome.largest_step_m, 0.1);
}

TEST(Dipo, BeamUpdatesAreAsAccurateAsVelocityUpdates) {
  Dive dive;
  dive.beams = true;
  EXPECT_LT(run_dive(dive, {}, make_test_rig()).end_error_m, 0.3);
}

TEST(Dipo, SingleBeamInLockBoundsDrift) {
  Dive dive;
  dive.beams = true;
  int k = 0;
  dive.disturb_dvl = [&k](DvlSample& ping, double t) {
    ++k;
    if (t < 10.0) return;
    ping.valid = false;
    for (std::size_t i = 0; i < kDvlBeams; ++i) {
      ping.beams[i]->valid = i == static_cast<std::size_t>(k) % kDvlBeams;
    }
  };
  const double one = run_dive(dive, {}, make_test_rig()).end_error_m;
  dive.disturb_dvl = [](DvlSample& ping, double t) {
    ping.valid = t < 10.0;
    for (auto& beam : ping.beams) beam->valid = ping.valid;
  };
  const double none = run_dive(dive, {}, make_test_rig()).end_error_m;
  EXPECT_LT(one, 0.5);
  EXPECT_LT(one, 0.5 * none);
}

TEST(Dipo, EstimatesTheTimeOffsetFromZeroWithinAMinute) {
  for (const double delay : {0.1, 0.3, 0.5}) {
    Dive dive;
    dive.dvl_delay_s = delay;
    const Outcome outcome = run_dive(dive, {}, make_test_rig());
    EXPECT_NEAR(outcome.last->state.dvl_time_offset_s, delay, 0.02);
  }
}

TEST(Dipo, EstimatesTheLeverArmStartingFromZero) {
  Rig wrong = make_test_rig();
  wrong.dvl->T_body_dvl.translation.setZero();
  Config config;
  config.dvl.lever_arm = {.estimate = true, .sigma = 0.5, .walk = 1e-5};
  Dive dive;
  dive.duration_s = 120.0;
  const Outcome outcome = run_dive(dive, config, wrong);
  const Vector3d truth = dive.truth.dvl->T_body_dvl.translation;
  EXPECT_LT((outcome.last->state.p_body_dvl - truth).norm(), 0.05);
}

TEST(Dipo, EstimatesTheMountingFromFiveDegreesOff) {
  Rig wrong = make_test_rig();
  Quaterniond& mounting = wrong.dvl->T_body_dvl.rotation;
  mounting = mounting * so3::exp(Vector3d(0.05, -0.04, 0.06));
  Config config;
  config.dvl.mounting.estimate = true;
  Dive dive;
  dive.duration_s = 120.0;
  const Outcome outcome = run_dive(dive, config, wrong);
  EXPECT_LT(so3::angle_between(outcome.last->state.R_body_dvl, dive.truth.dvl->T_body_dvl.rotation),
            0.01);
}

TEST(Dipo, RejectsDvlOutliers) {
  Dive dive;
  Random random(7);
  dive.disturb_dvl = [&random](DvlSample& ping, double t) {
    if (t > 5.0 && random.uniform() < 0.1) ping.velocity += test::random_vector(random, 5.0);
  };
  const Outcome outcome = run_dive(dive, {}, make_test_rig());
  EXPECT_GT(outcome.pings.at(Verdict::rejected), 5);
  EXPECT_LT(outcome.end_error_m, 0.4);
}

TEST(Dipo, IgnoresAConstantZeroDvlVelocity) {
  Dive dive;
  dive.duration_s = 120.0;
  dive.disturb_dvl = [](DvlSample& ping, double t) {
    if (t > 30.0 && t < 90.0) ping.velocity.setZero();
  };
  const Outcome outcome = run_dive(dive, {}, make_test_rig());
  EXPECT_GT(outcome.pings.at(Verdict::repeated), 250);
  EXPECT_EQ(outcome.zero_velocity_updates, 0U);
}

TEST(Dipo, RejectsPressureSpikes) {
  Dive dive;
  dive.disturb_pressure = [](PressureSample& s, double t) {
    if (std::fmod(t, 7.0) < 0.1 && t > 5.0) s.pressure_pa += 2e5;
  };
  const Outcome outcome = run_dive(dive, {}, make_test_rig());
  EXPECT_LT(outcome.end_error_m, 0.3);
  EXPECT_LT(outcome.largest_step_m, 0.1);
}

TEST(Dipo, WavePressureDoesNotCauseMotion) {
  Dive dive;
  dive.disturb_pressure = [](PressureSample& s, double t) {
    s.pressure_pa += 1000.0 * std::sin(t);  // 0.1 m of water every 6.3 s
  };
  Rig rig = make_test_rig();
  rig.pressure->noise_m = 0.003;
  const Outcome measured = run_dive(dive, {}, rig);
  EXPECT_LT(measured.end_error_m, 0.3);
  EXPECT_NEAR(measured.last->state.nav.accel_bias.norm(), 0.0, 0.02);
  Config without_swell;
  without_swell.depth.swell_window_s = 0.0;
  const Outcome unmeasured = run_dive(dive, without_swell, rig);
  EXPECT_LT(measured.end_error_m, 0.5 * unmeasured.end_error_m);
}

// Sigma estimated by the tracker from 20 readings a second.
double swell_found(const std::function<double(double)>& pressed, double window_s = 10.0) {
  SwellTracker tracker(window_s);
  for (int k = 0; k < 400; ++k) {
    const double t = 0.05 * k;
    tracker.add(Stamp{k * std::int64_t{50'000'000}}, 5.0 + 0.3 * t + pressed(t), 0.3);
  }
  return tracker.sigma_m();
}

TEST(SwellTracker, EstimatesTheWaveAmplitudeAndNothingInCalmWater) {
  EXPECT_LT(swell_found([](double) { return 0.0; }), 1e-6);
  EXPECT_LT(swell_found([](double t) { return 0.01 * t; }), 1e-6);  // a linear drift is not a wave
  const double found = swell_found([](double t) { return 0.1 * std::sin(t); });
  EXPECT_GT(found, 0.06);
  EXPECT_LT(found, 0.13);
  EXPECT_EQ(swell_found([](double t) { return 0.1 * std::sin(t); }, 0.0), 0.0);
}

TEST(SwellTracker, IgnoresDelayedVelocities) {
  SwellTracker tracker(10.0);
  for (int k = 0; k < 400; ++k) {
    const double t = 0.05 * k;
    tracker.add(Stamp{k * std::int64_t{50'000'000}}, std::sin(t), std::cos(t - 0.1));
  }
  EXPECT_LT(tracker.sigma_m(), 0.005);
}

TEST(SwellTracker, IgnoresSpikes) {
  int k = 0;
  EXPECT_LT(swell_found([&k](double) { return ++k % 10 == 0 ? 2.0 : 0.0; }), 1e-3);
}

TEST(SwellTracker, StartsWithASmallDefaultSigma) {
  SwellTracker tracker(10.0);
  tracker.add(Stamp{0}, 5.0, 0.0);
  EXPECT_NEAR(tracker.sigma_m(), 0.0075, 1e-12);
  tracker.add(Stamp{50'000'000}, 5.0, 0.0);
  EXPECT_EQ(tracker.correlated_samples(), 1.0);
}

TEST(Dipo, ContinuesAfterAGapInTheInertialData) {
  Dive dive;
  dive.imu_present = [](double t) { return t < 20.0 || t > 25.0; };
  const Outcome outcome = run_dive(dive, {}, make_test_rig());
  EXPECT_LT(outcome.end_error_m,
            5.0);  // five without_swell seconds at half a meter a second, and a turn
  EXPECT_LT(outcome.last->state.nav.v_body.norm(), 1.5);
}

TEST(Dipo, RejectsSaturatedInertialSamples) {
  Dive dive;
  Random random(8);
  dive.disturb_imu = [&random](ImuSample& sample, double t) {
    if (t < 20.0 || t > 20.3) return;
    sample.gyro += test::random_vector(random, 40.0);
    sample.accel += test::random_vector(random, 400.0);
  };
  const Outcome outcome = run_dive(dive, {}, make_test_rig());
  EXPECT_LT(outcome.end_error_m, 0.5);
  EXPECT_LT(std::abs(outcome.heading_error_rad), 0.05);
}

TEST(Dipo, WaitingForReportsMissingBottomLock) {
  Dipo dipo({}, make_test_rig());
  EXPECT_EQ(dipo.waiting_for(), "inertial samples");
  dipo.add(ImuSample{{1'000'000'000}, Vector3d::Zero(), Vector3d(0.0, 0.0, 9.8)});
  EXPECT_EQ(dipo.waiting_for(), "a DVL ping with bottom lock");
  dipo.add(DvlSample{.stamp = {1'001'000'000},
                     .velocity = Vector3d::Zero(),
                     .valid = false,
                     .figure_of_merit = {},
                     .altitude = {},
                     .beams = {}});
  EXPECT_EQ(dipo.waiting_for(), "a DVL ping with bottom lock");
  EXPECT_FALSE(dipo.latest());
}

TEST(Dipo, ZeroVelocityUpdatesHoldThePosition) {
  Config config;
  Dipo dipo(config, make_test_rig());
  Random random(9);
  for (int k = 0; k < 12000; ++k) {
    const Stamp stamp{1'000'000'000 + k * std::int64_t{10'000'000}};
    dipo.add(ImuSample{stamp, test::normal_vector(random, 1e-3),
                       Vector3d(0.0, 0.0, 9.80665) + test::normal_vector(random, 0.01)});
    if (k % 20 == 0) {
      dipo.add(DvlSample{.stamp = stamp,
                         .velocity = test::normal_vector(random, 0.003),
                         .valid = true,
                         .figure_of_merit = {},
                         .altitude = {},
                         .beams = {}});
    }
  }
  EXPECT_GT(dipo.zero_velocity_updates(), 50U);
  EXPECT_LT(dipo.latest()->state.nav.p_world.norm(), 0.1);
  EXPECT_LT(dipo.latest()->state.nav.v_body.norm(), 0.005);
}

TEST(Dipo, DisplacementResidualIsUsed) {
  Config config;
  config.dvl.use_displacement = true;
  const Outcome with = run_dive({}, config, make_test_rig());
  const Outcome without = run_dive({}, {}, make_test_rig());
  EXPECT_LT(with.end_error_m, 0.3);
  EXPECT_NE(with.last->state.nav.p_world, without.last->state.nav.p_world);
}

TEST(Dipo, ThrowsWithoutADvl) {
  Rig rig = make_test_rig();
  rig.dvl.reset();
  EXPECT_THROW(Dipo({}, rig), InputError);
}

TEST(Dipo, EarthRotationModelBoundsHeadingDriftOfANavigationGradeGyro) {
  Rig rig = make_test_rig();
  rig.imu->gyro_noise_density = 1e-6;
  rig.imu->gyro_random_walk = 0.0;
  const double latitude = 0.6;
  const Vector3d earth(0.0, 7.292115e-5 * std::cos(latitude), 7.292115e-5 * std::sin(latitude));
  Dive dive;
  dive.duration_s = 300.0;
  const Se3Spline spline = test::wavy_spline(dive.seed, dive.duration_s);
  dive.disturb_imu = [&](ImuSample& sample, double) {
    sample.gyro += spline.at(sample.stamp).T_world_body.rotation.conjugate() * earth;
  };
  Config config;
  const double without = run_dive(dive, config, rig).heading_error_rad;
  config.earth.latitude_deg = latitude * 180.0 / std::acos(-1.0);
  const double with = run_dive(dive, config, rig).heading_error_rad;
  EXPECT_GT(std::abs(without), 0.008);  // five minutes of the vertical component: 12 mrad
  EXPECT_LT(std::abs(with), 0.003);
}

}  // namespace
}  // namespace apvi::dipo
