// SPDX-License-Identifier: BSD-3-Clause
#include "vio/factors/factors.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "vio/factor_check.hpp"

namespace apvi::vio {
namespace {

using apvi::test::random_vector;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using test::as_motion;
using test::as_pose;
using test::as_vector;
using test::expect_jacobians;
using test::nudged;
using test::residual;
using test::Values;
using View = ReprojectionFactor::View;
const Vector3d kGravity(0.0, 0.0, -9.80665);

const SE3 kBodyCamera{so3::exp({-1.2, 1.1, -1.3}), {0.1, -0.05, 0.2}};
const SE3 kBodyOther{so3::exp({-1.22, 1.13, -1.25}), {0.12, 0.1, 0.18}};

/// Two poses and a point of known depth in the first camera.
struct Scene {
  Random random;
  SE3 pose_i, pose_j;
  Vector2d point_i;
  double depth;

  explicit Scene(std::uint64_t seed) : random(seed) {
    pose_i = test::random_pose(random, 2.0, 20.0);
    pose_j = pose_i * test::random_pose(random, 0.15, 0.4);
    point_i = {random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5)};
    depth = random.uniform(1.5, 8.0);
  }
  Vector2d seen(const SE3& T_body_camera) const {
    const Vector3d world = pose_i * (kBodyCamera * (depth * point_i.homogeneous()));
    return (T_body_camera.inverse() * (pose_j.inverse() * world)).hnormalized();
  }
  ImageMotion motion() {
    return {random_vector(random, 0.5), random_vector(random, 0.8), random.uniform(-0.02, 0.02)};
  }
};

TEST(ReprojectionFactor, IsZeroForAnExactObservation) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Scene s(seed);
    const ReprojectionFactor factor({s.point_i}, {s.seen(kBodyCamera)}, 400.0, nullptr, nullptr);
    const Values x{as_vector(to_block(s.pose_i)),
                   as_vector(to_block(s.pose_j)),
                   as_vector(to_block(kBodyCamera)),
                   {1.0 / s.depth},
                   {0.0},
                   {0.0, 0.0, 0.0}};
    EXPECT_LT(residual(factor, x).norm(), 1e-9);
  }
}

// Perturbed parameter values of a term.
Values visual_values(Scene& s, bool two_cameras) {
  Values x{as_vector(to_block(s.pose_i)), as_vector(to_block(s.pose_j)),
           as_vector(to_block(kBodyCamera))};
  if (two_cameras) x.push_back(as_vector(to_block(kBodyOther)));
  x.push_back({1.1 / s.depth});
  x.push_back({0.013});
  x.push_back({0.03, -0.02, 0.01});
  if (two_cameras) x.push_back({-0.02, 0.015, 0.03});
  x[1] = nudged(x[1], s.random, 0.02);
  return x;
}

TEST(ReprojectionFactor, JacobiansMatchNumericDifferences) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    Scene s(seed);
    const ReprojectionFactor factor({s.point_i, s.motion()}, {s.seen(kBodyCamera), s.motion()},
                                    300.0, nullptr, nullptr);
    expect_jacobians(factor, visual_values(s, false));
  }
}

TEST(ReprojectionFactor, EvaluatesJacobiansAtFirstEstimatesAndResidualsAtTheState) {
  Scene s(31);
  const View i{s.point_i, s.motion()};
  const View j{s.seen(kBodyCamera), s.motion()};
  const Values x = visual_values(s, false);
  Values first_values = x;
  first_values[0] = nudged(x[0], s.random, 0.05);
  first_values[1] = nudged(x[1], s.random, 0.05);
  const FirstEstimate first_i{.pose = as_pose(first_values[0]), .motion = {}};
  const FirstEstimate first_j{.pose = as_pose(first_values[1]), .motion = {}};
  const ReprojectionFactor plain(i, j, 300.0, nullptr, nullptr);
  const ReprojectionFactor both(i, j, 300.0, &first_i, &first_j);
  expect_jacobians(both, x, plain, first_values);
  EXPECT_EQ(residual(both, x), residual(plain, x));
  const ReprojectionFactor one(i, j, 300.0, nullptr, &first_j);
  first_values[0] = x[0];
  expect_jacobians(one, x, plain, first_values);
}

TEST(ReprojectionFactor, AppliesTheUncompensatedTimeOffset) {
  // A camera stamp 0.03 s late with 0.01 s compensated: the image is 0.02 s older than the pose of
  // the frame, and the body moved in between.
  Scene s(5);
  const ImageMotion motion{{0.3, -0.2, 0.5}, {0.4, -0.1, 0.2}, 0.01};
  const SE3 at_image = s.pose_j * SE3{so3::exp(-0.02 * motion.rate), -0.02 * motion.velocity};
  const Vector3d world = s.pose_i * (kBodyCamera * (s.depth * s.point_i.homogeneous()));
  const View i{s.point_i, {.compensated_s = 0.03}};
  const View j{((at_image * kBodyCamera).inverse() * world).hnormalized(), motion};
  const ReprojectionFactor factor(i, j, 300.0, nullptr, nullptr);
  Values x = visual_values(s, false);
  x[1] = as_vector(to_block(s.pose_j));
  x[3] = {1.0 / s.depth};
  x[4] = {0.03};
  x[5] = {0.0, 0.0, 0.0};
  EXPECT_LT(residual(factor, x).norm(), 1e-9);
}

TEST(ReprojectionFactor, AppliesTheLensCorrection) {
  // The true focal length is 3 % longer than the rig's, the principal point elsewhere.
  const Scene s(7);
  const LensBlock lens{std::log(1.03), 0.02, -0.01};
  const auto by_rig = [](const Vector2d& p) -> Vector2d {
    return 1.03 * p + Vector2d(0.02, -0.01);
  };
  const ReprojectionFactor factor({by_rig(s.point_i)}, {by_rig(s.seen(kBodyCamera))}, 400.0,
                                  nullptr, nullptr);
  const Values x{as_vector(to_block(s.pose_i)),
                 as_vector(to_block(s.pose_j)),
                 as_vector(to_block(kBodyCamera)),
                 {1.0 / s.depth},
                 {0.0},
                 {lens.begin(), lens.end()}};
  EXPECT_LT(residual(factor, x).norm(), 1e-9);
}

TEST(ReprojectionFactor, IsFiniteAtInfinityAndBehindTheCamera) {
  Scene s(8);
  const ReprojectionFactor factor({s.point_i, s.motion()}, {s.seen(kBodyCamera), s.motion()}, 300.0,
                                  nullptr, nullptr);
  Values x = visual_values(s, false);
  for (const double lambda : {0.0, -0.3, 1e-12, 50.0}) {
    SCOPED_TRACE(lambda);
    x[3] = {lambda};
    EXPECT_TRUE(residual(factor, x).allFinite());
    expect_jacobians(factor, x);
  }
  x[3] = {0.5};
  x[1] = as_vector(to_block(s.pose_i * kBodyCamera * SE3{so3::exp({0.0, 3.1, 0.0}), {0, 0, 9.0}} *
                            kBodyCamera.inverse()));
  EXPECT_TRUE(residual(factor, x).allFinite());
  EXPECT_GT(residual(factor, x).norm(), 100.0) << "large residual behind the camera";
  expect_jacobians(factor, x);
}

TEST(CrossCameraFactor, IsZeroForAnExactObservation) {
  const Scene s(3);
  const CrossCameraFactor factor({s.point_i}, {s.seen(kBodyOther)}, 400.0, nullptr, nullptr);
  const Values x{as_vector(to_block(s.pose_i)),
                 as_vector(to_block(s.pose_j)),
                 as_vector(to_block(kBodyCamera)),
                 as_vector(to_block(kBodyOther)),
                 {1.0 / s.depth},
                 {0.0},
                 {0.0, 0.0, 0.0},
                 {0.0, 0.0, 0.0}};
  EXPECT_LT(residual(factor, x).norm(), 1e-9);
}

TEST(CrossCameraFactor, JacobiansMatchNumericDifferencesAlsoAtFirstEstimates) {
  for (std::uint64_t seed = 40; seed < 50; ++seed) {
    Scene s(seed);
    const View i{s.point_i, s.motion()};
    const View j{s.seen(kBodyOther), s.motion()};
    const CrossCameraFactor plain(i, j, 300.0, nullptr, nullptr);
    const Values x = visual_values(s, true);
    expect_jacobians(plain, x);
    Values first_values = x;
    first_values[0] = nudged(x[0], s.random, 0.05);
    const FirstEstimate first{.pose = as_pose(first_values[0]), .motion = {}};
    const CrossCameraFactor fixed(i, j, 300.0, &first, nullptr);
    expect_jacobians(fixed, x, plain, first_values);
    EXPECT_EQ(residual(fixed, x), residual(plain, x));
  }
}

TEST(StereoFactor, IsZeroForExactObservationsAndJacobiansMatch) {
  Random random(6);
  for (int n = 0; n < 10; ++n) {
    const Vector2d a(random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5));
    const double depth = random.uniform(0.5, 5.0);
    const Vector2d b =
        (kBodyOther.inverse() * (kBodyCamera * (depth * a.homogeneous()))).hnormalized();
    const StereoFactor factor(a, b, 250.0);
    Values x{as_vector(to_block(kBodyCamera)),
             as_vector(to_block(kBodyOther)),
             {1.0 / depth},
             {0.0, 0.0, 0.0},
             {0.0, 0.0, 0.0}};
    EXPECT_LT(residual(factor, x).norm(), 1e-9);
    x[2] = {1.2 / depth};
    x[3] = {0.03, -0.02, 0.01};
    x[4] = {-0.02, 0.015, 0.03};
    expect_jacobians(factor, x);
  }
}

/// Inertial samples along a curve and their preintegration, with slightly wrong biases.
struct Inertial {
  Se3Spline spline = apvi::test::wavy_spline(11, 4.0);
  std::vector<ImuSample> samples = apvi::test::imu_along(spline, kGravity, 200.0);
  Vector3d bias_gyro{0.01, -0.02, 0.03};
  Vector3d bias_accel{0.1, 0.2, -0.1};

  std::shared_ptr<const imu::Preintegration> sum(std::size_t from, std::size_t to) const {
    auto result = std::make_shared<imu::Preintegration>(imu::Noise{}, bias_gyro, bias_accel);
    for (std::size_t i = from; i < to; ++i) {
      ImuSample a = samples[i];
      ImuSample b = samples[i + 1];
      for (ImuSample* s : {&a, &b}) {
        s->gyro += bias_gyro;
        s->accel += bias_accel;
      }
      result->integrate(a, b);
    }
    return result;
  }
  FrameState state(std::size_t at) const {
    const Motion m = spline.at(samples[at].stamp);
    FrameState state{.pose = to_block(m.T_world_body), .motion = {}};
    Eigen::Map<Vector3d>(state.motion.data()) = m.velocity_world;
    Eigen::Map<Vector3d>(state.motion.data() + 3) = bias_gyro;
    Eigen::Map<Vector3d>(state.motion.data() + 6) = bias_accel;
    return state;
  }
  Values values(std::size_t i, std::size_t j) const {
    return {as_vector(state(i).pose), as_vector(state(i).motion), as_vector(state(j).pose),
            as_vector(state(j).motion)};
  }
};

Values all_nudged(const Values& x, Random& random, double size) {
  Values result;
  for (const auto& block : x) result.push_back(nudged(block, random, size));
  return result;
}

TEST(ImuFactor, IsSmallAlongTheTrueMotion) {
  const Inertial inertial;
  const ImuFactor factor(inertial.sum(50, 130), kGravity, nullptr, nullptr);
  // In standard deviations: only the error of the midpoint rule remains.
  EXPECT_LT(residual(factor, inertial.values(50, 130)).norm(), 0.2);
}

TEST(ImuFactor, IsWhitenedByThePreintegrationCovariance) {
  const Inertial inertial;
  const auto sum = inertial.sum(50, 70);
  const ImuFactor factor(sum, kGravity, nullptr, nullptr);
  Random random(4);
  Values x = inertial.values(50, 70);
  const Eigen::VectorXd at_truth = residual(factor, x);
  // A motion that differs by a given error of the preintegration.
  Eigen::Matrix<double, 15, 1> error;
  for (double& e : error) e = random.uniform(-1e-6, 1e-6);
  const SE3 i = to_se3(x[0].data());
  Eigen::Matrix<double, 6, 1> pose_change;
  pose_change << error.head<3>(), i.rotation * error.segment<3>(6);
  x[2] = test::plus(x[2], pose_change);
  Eigen::Map<Vector3d>(x[3].data()) += i.rotation * error.segment<3>(3);
  Eigen::Map<Eigen::Matrix<double, 6, 1>>(x[3].data() + 3) += error.tail<6>();
  const Eigen::VectorXd change = residual(factor, x) - at_truth;
  const double expected = error.dot(sum->covariance().ldlt().solve(error));
  EXPECT_NEAR(change.squaredNorm() / expected, 1.0, 1e-3);
}

TEST(ImuFactor, JacobiansMatchNumericDifferences) {
  const Inertial inertial;
  Random random(7);
  for (const std::size_t to : {60U, 90U, 250U}) {
    const ImuFactor factor(inertial.sum(50, to), kGravity, nullptr, nullptr);
    expect_jacobians(factor, all_nudged(inertial.values(50, to), random, 0.03));
    expect_jacobians(factor, all_nudged(inertial.values(50, to), random, 0.5), 1e-6);
  }
}

TEST(ImuFactor, EvaluatesJacobiansAtFirstEstimatesAndResidualsAtTheState) {
  const Inertial inertial;
  Random random(8);
  const auto sum = inertial.sum(50, 70);
  const Values x = all_nudged(inertial.values(50, 70), random, 0.02);
  Values first = all_nudged(x, random, 0.02);
  const FirstEstimate first_i{.pose = as_pose(first[0]), .motion = as_motion(first[1])};
  FirstEstimate first_j{.pose = as_pose(first[2]), .motion = as_motion(first[3])};
  const ImuFactor plain(sum, kGravity, nullptr, nullptr);
  expect_jacobians(ImuFactor(sum, kGravity, &first_i, &first_j), x, plain, first);
  first_j.motion.reset();
  first[3] = x[3];
  const ImuFactor fixed(sum, kGravity, &first_i, &first_j);
  expect_jacobians(fixed, x, plain, first);
  EXPECT_EQ(residual(fixed, x), residual(plain, x));
}

TEST(ImuFactor, IsFiniteForASingularCovariance) {
  const Inertial inertial;
  const ImuFactor factor(inertial.sum(50, 51), kGravity, nullptr, nullptr);
  Random random(9);
  const Values x = all_nudged(inertial.values(50, 51), random, 1e-3);
  EXPECT_TRUE(residual(factor, x).allFinite());
  expect_jacobians(factor, x, 1e-6);
}

TEST(ImuFactor, RejectsAnEmptyPreintegration) {
  const auto empty =
      std::make_shared<const imu::Preintegration>(imu::Noise{}, Vector3d::Zero(), Vector3d::Zero());
  EXPECT_THROW(ImuFactor(empty, kGravity, nullptr, nullptr), std::logic_error);
}

DvlPing ping_at(const Inertial& inertial, std::size_t frame, std::size_t at,
                const SE3& T_body_dvl) {
  DvlPing ping;
  ping.since_frame = inertial.sum(frame, at);
  const Motion m = inertial.spline.at(inertial.samples[at].stamp);
  ping.gyro = inertial.samples[at].gyro + inertial.bias_gyro;
  const Vector3d v_body = m.T_world_body.rotation.conjugate() * m.velocity_world;
  ping.velocity = T_body_dvl.rotation.conjugate() *
                  (v_body + m.angular_velocity_body.cross(T_body_dvl.translation));
  ping.sqrt_information << 200.0, 3.0, -4.0, 0.0, 150.0, 7.0, 0.0, 0.0, 300.0;
  return ping;
}

const SE3 kBodyDvl{so3::exp({0.4, -0.6, 2.0}), {0.3, -0.2, 0.5}};

Values ping_values(const FrameState& state) {
  return {as_vector(state.pose), as_vector(state.motion), as_vector(to_block(kBodyDvl)), {0.0}};
}

TEST(DvlVelocityFactor, IsSmallAlongTheTrueMotion) {
  const Inertial inertial;
  const DvlPing ping = ping_at(inertial, 50, 73, kBodyDvl);
  const DvlVelocityFactor factor(ping, kGravity, nullptr);
  const FrameState state = inertial.state(50);
  EXPECT_LT(residual(factor, ping_values(state)).norm(), 0.02);
}

TEST(DvlVelocityFactor, AppliesTheScaleCorrection) {
  const Inertial inertial;
  DvlPing ping = ping_at(inertial, 50, 73, kBodyDvl);
  const Values right = ping_values(inertial.state(50));
  const Eigen::VectorXd expected = residual(DvlVelocityFactor(ping, kGravity, nullptr), right);
  ping.velocity /= 1.02;  // 2 % too short
  Values x = right;
  x[3] = {std::log(1.02)};
  const DvlVelocityFactor factor(ping, kGravity, nullptr);
  EXPECT_LT((1.02 * residual(factor, x) - expected).norm(), 1e-9);
}

TEST(DvlVelocityFactor, JacobiansMatchNumericDifferencesAlsoAtFirstEstimates) {
  const Inertial inertial;
  Random random(12);
  for (const std::size_t at : {50U, 52U, 90U}) {
    const DvlPing ping = ping_at(inertial, 50, at, kBodyDvl);
    const DvlVelocityFactor plain(ping, kGravity, nullptr);
    const FrameState state = inertial.state(50);
    const Values x = all_nudged(ping_values(state), random, 0.05);
    expect_jacobians(plain, x);
    Values first_values = all_nudged(x, random, 0.05);
    std::copy(x.begin() + 2, x.end(), first_values.begin() + 2);  // calibration has none
    const FirstEstimate first{.pose = as_pose(first_values[0]),
                              .motion = as_motion(first_values[1])};
    const DvlVelocityFactor fixed(ping, kGravity, &first);
    expect_jacobians(fixed, x, plain, first_values);
    EXPECT_EQ(residual(fixed, x), residual(plain, x));
  }
}

TEST(DvlVelocityFactor, IsInvariantToYawAndPosition) {
  const Inertial inertial;
  const DvlVelocityFactor factor(ping_at(inertial, 50, 73, kBodyDvl), kGravity, nullptr);
  const FrameState state = inertial.state(50);
  const Values x = ping_values(state);
  const Eigen::MatrixXd by_pose = test::analytic_jacobian(factor, x, 0);
  const Eigen::MatrixXd by_motion = test::analytic_jacobian(factor, x, 1);
  // Rotates the vehicle and its velocity about the vertical.
  const Vector3d up = Vector3d::UnitZ();
  const Vector3d velocity(state.motion.data());
  const Vector3d yaw = by_pose.leftCols<3>() * (to_se3(x[0].data()).rotation.conjugate() * up) +
                       by_motion.leftCols<3>() * up.cross(velocity);
  EXPECT_LT(yaw.norm(), 1e-10 * by_pose.norm());
  EXPECT_TRUE(by_pose.rightCols<3>().isZero(0.0));
  EXPECT_GT(by_pose.leftCols<3>().norm(), 1.0) << "tilt is observable";
}

TEST(PressureDepthFactor, AppliesTheLeverArmAndJacobianMatches) {
  Random random(14);
  const Vector3d lever(0.2, -0.3, 0.4);
  for (const double sign : {1.0, -1.0}) {
    const SE3 pose = test::random_pose(random, 1.0, 5.0);
    const double zero = random.uniform(-2.0, 2.0);
    const double depth = sign * (pose * lever).z() + zero;
    const PressureDepthFactor plain(depth, 0.02, lever, sign, nullptr);
    Values x{as_vector(to_block(pose)), {zero}};
    EXPECT_LT(residual(plain, x).norm(), 1e-10);
    x = all_nudged(x, random, 0.2);
    expect_jacobians(plain, x);
    const Values first_values = all_nudged(x, random, 0.1);
    const FirstEstimate first{.pose = as_pose(first_values[0]), .motion = {}};
    expect_jacobians(PressureDepthFactor(depth, 0.02, lever, sign, &first), x, plain, first_values);
  }
}

TEST(PressureDepthFactor, ResidualIsInSigmas) {
  const PressureDepthFactor factor(5.0, 0.02, Vector3d::Zero(), -1.0, nullptr);
  const Values x{as_vector(to_block({Eigen::Quaterniond::Identity(), {1.0, 2.0, -4.02}})), {1.0}};
  EXPECT_NEAR(residual(factor, x)(0), 1.0, 1e-9);
}

TEST(PosePriorFactor, IsTheWhitenedTangentAndJacobianMatches) {
  Random random(15);
  Eigen::Matrix<double, 6, 6> S = Eigen::Matrix<double, 6, 6>::Identity() * 30.0;
  S(0, 4) = 5.0;
  S(2, 3) = -7.0;
  const SE3 pose = test::random_pose(random, 2.0, 5.0);
  const PosePriorFactor factor(pose, S);
  Eigen::VectorXd delta(6);
  delta << 0.3, -0.2, 0.5, 1.0, -2.0, 0.7;
  const Values x{test::plus(as_vector(to_block(pose)), delta)};
  EXPECT_TRUE(residual(factor, x).isApprox(S * delta, 1e-10));
  expect_jacobians(factor, x);
}

TEST(MotionPriorFactor, IsTheWhitenedDifferenceAndJacobianMatches) {
  Random random(16);
  Eigen::Matrix<double, 9, 9> S = Eigen::Matrix<double, 9, 9>::Identity() * 30.0;
  S(0, 4) = 5.0;
  S(8, 3) = -7.0;
  const MotionBlock motion = test::random_motion(random);
  const MotionPriorFactor factor(motion, S);
  const Values x{nudged(as_vector(motion), random, 0.5)};
  const Eigen::Map<const Eigen::Matrix<double, 9, 1>> now(x[0].data());
  const Eigen::Map<const Eigen::Matrix<double, 9, 1>> then(motion.data());
  EXPECT_TRUE(residual(factor, x).isApprox(S * (now - then), 1e-12));
  expect_jacobians(factor, x);
}

}  // namespace
}  // namespace apvi::vio
