// SPDX-License-Identifier: BSD-3-Clause
#include "sim/sensors/dvl_sim.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "sim/motion/motion.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;

constexpr Stamp kStart{1'700'000'000'000'000'000};

TriangleMesh plane(float z, float slope = 0.0F) {
  TriangleMesh mesh;
  constexpr float kHalf = 500.0F;
  const auto corner = [&](float x, float y) { return mesh.add_vertex({x, y, z + slope * x}); };
  const auto a = corner(-kHalf, -kHalf);
  const auto b = corner(kHalf, -kHalf);
  const auto c = corner(kHalf, kHalf);
  const auto d = corner(-kHalf, kHalf);
  mesh.add_quad(a, b, c, d, Material::plain);
  return mesh;
}

// Forward-right-down sensor below and behind the body's origin.
DvlCalibration mounted() {
  DvlCalibration dvl;
  dvl.T_body_dvl = {Eigen::Quaterniond(0.0, 1.0, 0.0, 0.0), Vector3d(-0.3, 0.1, -0.2)};
  dvl.beams = default_dvl_beams();
  return dvl;
}

Se3Spline survey(double z, double duration_s, double speed = 0.5, bool steady = false) {
  MotionConfig config;
  config.origin = {0.0, 0.0, z};
  config.speed_m_s = speed;
  config.length_m = steady ? 400.0 : 8.0;
  if (steady) config.attitude = {0, 0, 0, 0, 0, 3.0, 0};
  return plan_motion(config, {.start = kStart, .duration_s = duration_s, .seed = 9, .height = {}});
}

DvlSimConfig ideal() {
  DvlSimConfig config;
  config.use(DvlPreset::ideal);
  return config;
}

std::vector<DvlSample> pings(const Se3Spline& spline, const DvlSimConfig& config, double duration_s,
                             float bottom = -10.0F, const EventSchedule& events = {},
                             const DvlCalibration& dvl = mounted()) {
  const RayCaster world(plane(bottom));
  return simulate_dvl(spline, world, dvl, config, events, kStart, duration_s, 4);
}

double valid_share(const std::vector<DvlSample>& samples) {
  double valid = 0.0;
  for (const DvlSample& sample : samples) valid += sample.valid ? 1.0 : 0.0;
  return valid / static_cast<double>(samples.size());
}

double rate(const std::vector<DvlSample>& samples) {
  return static_cast<double>(samples.size() - 1) /
         seconds_between(samples.front().stamp, samples.back().stamp);
}

TEST(DvlSim, BeamVelocitiesAreProjectionsOfTheSensorVelocity) {
  const Se3Spline spline = survey(-6.0, 40.0);
  const DvlCalibration dvl = mounted();
  const auto samples = pings(spline, ideal(), 40.0);
  ASSERT_GT(samples.size(), 100U);
  for (const DvlSample& sample : samples) {
    const Motion motion = spline.at(sample.stamp);
    const Eigen::Matrix3d R_world_dvl =
        (motion.T_world_body * dvl.T_body_dvl).rotation.toRotationMatrix();
    // Finite differences of the sensor position, independent of the lever-arm formula.
    const Duration h = Duration::from_seconds(1e-3);
    const Vector3d before = (spline.at(sample.stamp - h).T_world_body * dvl.T_body_dvl).translation;
    const Vector3d after = (spline.at(sample.stamp + h).T_world_body * dvl.T_body_dvl).translation;
    const Vector3d velocity = R_world_dvl.transpose() * (after - before) / 2e-3;
    ASSERT_TRUE(sample.valid);
    EXPECT_LT((sample.velocity - velocity).norm(), 1e-5);
    for (std::size_t i = 0; i < kDvlBeams; ++i) {
      EXPECT_NEAR(sample.beams[i]->velocity, dvl.beams[i].dot(velocity), 1e-5);
    }
  }
}

TEST(DvlSim, RangesAndAltitudeMatchAPlane) {
  const Se3Spline spline = survey(-6.0, 10.0, 0.5, true);
  for (const DvlSample& sample : pings(spline, ideal(), 10.0)) {
    const double height = 10.0 - 6.0 - 0.2;
    EXPECT_NEAR(*sample.altitude, height, 0.01);  // the footprint mean is slightly larger
    EXPECT_NEAR(*sample.beams[0]->range, height / std::cos(22.5 * std::numbers::pi / 180.0), 0.01);
  }
}

TEST(DvlSim, StampsAreDelayedByTheTimeOffset) {
  DvlCalibration dvl = mounted();
  dvl.time_offset_s = 0.15;
  const Se3Spline spline = survey(-6.0, 20.0);
  for (const DvlSample& sample : pings(spline, ideal(), 20.0, -10.0F, {}, dvl)) {
    const Motion motion = spline.at(sample.stamp - Duration::from_seconds(0.15));
    const Vector3d v = motion.T_world_body.rotation.conjugate() * motion.velocity_world +
                       motion.angular_velocity_body.cross(dvl.T_body_dvl.translation);
    EXPECT_LT((dvl.T_body_dvl.rotation * sample.velocity - v).norm(), 1e-6);
  }
}

TEST(DvlSim, BeamNoiseMatchesTheConfiguration) {
  DvlSimConfig config = ideal();
  config.noise_floor = 0.003;
  config.noise_per_speed = 0.01;
  config.scale_error = 0.02;
  config.rate_hz = 20.0;
  const Se3Spline spline = survey(-6.0, 400.0, 0.8, true);
  const DvlCalibration dvl = mounted();
  double squares = 0.0;
  double count = 0.0;
  for (const DvlSample& sample : pings(spline, config, 400.0)) {
    const Motion motion = spline.at(sample.stamp);
    if (motion.velocity_world.norm() < 0.7999) continue;
    const Vector3d v = dvl.T_body_dvl.rotation.conjugate() *
                       (motion.T_world_body.rotation.conjugate() * motion.velocity_world);
    for (std::size_t i = 0; i < kDvlBeams; ++i, ++count) {
      squares += std::pow(sample.beams[i]->velocity - 1.02 * dvl.beams[i].dot(v), 2);
    }
  }
  ASSERT_GT(count, 20000.0);
  EXPECT_NEAR(std::sqrt(squares / count) / std::hypot(0.003, 0.008), 1.0, 0.05);
}

TEST(DvlSim, PingRateFollowsTheRangeMode) {
  const auto at_altitude = [](double altitude) {
    return rate(pings(survey(-60.0 + altitude + 0.2, 30.0, 0.3, true), ideal(), 30.0, -60.0F));
  };
  EXPECT_NEAR(at_altitude(0.4), 15.0, 0.5);
  EXPECT_NEAR(at_altitude(2.0), 8.8, 0.3);
  EXPECT_NEAR(at_altitude(9.0), 5.25, 0.2);
  EXPECT_NEAR(at_altitude(30.0), 4.0, 0.2);
}

TEST(DvlSim, LosesBottomLockBeyondMaxRangeAndMaxIncidence) {
  EXPECT_EQ(valid_share(pings(survey(-6.0, 10.0), ideal(), 10.0, -80.0F)), 0.0);
  DvlSimConfig narrow = ideal();
  narrow.max_incidence_deg = 20.0;  // the incidence on level ground is 22.5 degrees
  const auto samples = pings(survey(-6.0, 10.0, 0.5, true), narrow, 10.0);
  EXPECT_EQ(valid_share(samples), 0.0);
  EXPECT_EQ(samples.front().beams[0]->range, -1.0);
  EXPECT_EQ(samples.front().altitude, -1.0);
}

TEST(DvlSim, VelocityNeedsThreeBeams) {
  const auto directions = default_dvl_beams();
  const Vector3d truth(0.4, -0.1, 0.05);
  std::array<std::optional<DvlBeam>, kDvlBeams> beams;
  for (std::size_t i = 0; i < kDvlBeams; ++i) {
    beams[i] = DvlBeam{.velocity = directions[i].dot(truth), .range = 1.0, .valid = i != 2};
  }
  ASSERT_TRUE(solve_beam_velocity(beams, directions));
  EXPECT_LT((*solve_beam_velocity(beams, directions) - truth).norm(), 1e-12);
  beams[1]->valid = false;
  EXPECT_FALSE(solve_beam_velocity(beams, directions));
}

TEST(DvlSim, PeriodicBottomSearchLosesPings) {
  DvlSimConfig config = ideal();
  config.relock_probability = 1.0;
  const auto samples = pings(survey(-6.0, 100.0), config, 100.0);
  int gaps = 0;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const double gap = seconds_between(samples[i - 1].stamp, samples[i].stamp);
    if (gap > 0.3) ++gaps;
    EXPECT_LT(gap, 0.8);
  }
  EXPECT_GE(gaps, 9);
  EXPECT_LE(gaps, 10);
}

TEST(DvlSim, EventsCauseLossOfLockAndOutliers) {
  const EventSchedule events(
      {{EventKind::dvl_loss, 5.0, 10.0, 0.0, 0.0}, {EventKind::dvl_outliers, 15.0, 25.0, 0.4, 0.0}},
      30.0, 5.0);
  const Se3Spline spline = survey(-6.0, 30.0);
  const DvlCalibration dvl = mounted();
  int outliers = 0;
  for (const DvlSample& sample : pings(spline, ideal(), 30.0, -10.0F, events)) {
    const double t = seconds_between(kStart, sample.stamp);
    EXPECT_EQ(sample.valid, t < 5.0 || t >= 10.0) << t;
    const Motion motion = spline.at(sample.stamp);
    const Vector3d v = motion.T_world_body.rotation.conjugate() * motion.velocity_world +
                       motion.angular_velocity_body.cross(dvl.T_body_dvl.translation);
    const double error = (dvl.T_body_dvl.rotation * sample.velocity - v).norm();
    if (sample.valid && error > 0.05) {
      ++outliers;
      EXPECT_GE(t, 15.0);
      EXPECT_LT(t, 25.0);
    }
  }
  EXPECT_GT(outliers, 5);
}

// Logs of a real A50 at 9 m: 5.25 pings per second, parity noise of 4 to 5 mm/s per beam at 0.5 m/s
// and below 1 mm/s at rest, four valid beams in nearly every ping.
TEST(DvlSim, DefaultsMatchLogsOfARealA50) {
  DvlSimConfig config;
  const auto samples = pings(survey(-2.0, 240.0, 0.55), config, 240.0, -11.0F);
  double squares = 0.0;
  double count = 0.0;
  double four = 0.0;
  for (const DvlSample& s : samples) {
    const auto& b = s.beams;
    if (!(b[0]->valid && b[1]->valid && b[2]->valid && b[3]->valid)) continue;
    four += 1.0;
    const double parity = 0.5 * (b[0]->velocity - b[1]->velocity + b[2]->velocity - b[3]->velocity);
    if (std::abs(parity) > 0.02) continue;
    squares += parity * parity;
    count += 1.0;
  }
  const double n = static_cast<double>(samples.size());
  EXPECT_NEAR(rate(samples), 5.25, 0.3);
  EXPECT_GT(four / n, 0.95);
  EXPECT_GT(valid_share(samples), 0.99);
  EXPECT_NEAR(std::sqrt(squares / count), 0.0044, 0.0008);
}

}  // namespace
}  // namespace apvi::sim
