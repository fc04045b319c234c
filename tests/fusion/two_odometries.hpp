// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <optional>
#include <vector>

#include "fusion/random_pose.hpp"

namespace apvi::test {

/// A dive with simulated DIPO and VIO whose covariances are correct: both dead-reckon with known
/// noise; DIPO also measures height and tilt. VIO is initialized with the DIPO pose, including its
/// error.
struct TwoOdometries {
  double dt = 0.1;                  ///< [s]
  double dipo_rotation_deg = 0.10;  ///< walk [deg/sqrt(s)]
  double dipo_position = 0.010;     ///< walk [m/sqrt(s)]
  double vio_rotation_deg = 0.06;
  double vio_position = 0.008;
  double shared_rotation = 0.0;  ///< correlation of the rotation noises (one gyro)
  double speed_bias = 0.0;  ///< velocity bias of VIO that its covariance does not include [m/s]

  struct Frame {
    double t;
    SE3 truth;
    PoseEstimate dipo;
    std::optional<PoseEstimate> vio;
  };
  /// VIO is available in [start, end) of each span [s].
  std::vector<Frame> run(std::uint64_t seed, double duration_s,
                         const std::vector<std::pair<double, double>>& vio_spans) const;
};

namespace internal {

/// Dead reckoning with a measured motion of noise covariance Q, linearized at the estimate.
inline PoseEstimate reckon(const PoseEstimate& before, const SE3& measured, const Matrix6& Q) {
  const Eigen::Matrix3d R = before.T_world_body.rotation.toRotationMatrix();
  PoseEstimate now{before.T_world_body * measured, Matrix6::Zero()};
  Matrix6 A = Matrix6::Identity();
  A.topLeftCorner<3, 3>() = measured.rotation.conjugate().toRotationMatrix();
  A.bottomLeftCorner<3, 3>() = -R * so3::hat(measured.translation);
  Matrix6 to_world = Matrix6::Identity();
  to_world.bottomRightCorner<3, 3>() = R;
  now.covariance = A * before.covariance * A.transpose() + to_world * Q * to_world.transpose();
  return now;
}

/// DIPO's measurement of height (2 cm) and tilt (1 degree).
inline void measure(PoseEstimate& dipo, const SE3& truth, Random& random) {
  const Eigen::Vector3d sigma(1.0 * kRadiansPerDegree, 1.0 * kRadiansPerDegree, 0.02);
  const Vector6 error = boxminus(truth, dipo.T_world_body);
  Eigen::Matrix<double, 3, 6> H = Eigen::Matrix<double, 3, 6>::Zero();
  H.topLeftCorner<2, 3>() = dipo.T_world_body.rotation.toRotationMatrix().topRows<2>();
  H(2, 5) = 1.0;
  Eigen::Vector3d z = H * error;
  for (int i = 0; i < 3; ++i) z(i) += random.normal(0.0, sigma(i));
  const Eigen::Matrix3d S =
      H * dipo.covariance * H.transpose() + Eigen::Matrix3d(sigma.cwiseAbs2().asDiagonal());
  const Eigen::Matrix<double, 6, 3> K = S.ldlt().solve(H * dipo.covariance).transpose();
  dipo.T_world_body = boxplus(dipo.T_world_body, K * z);
  dipo.covariance = symmetric((Matrix6::Identity() - K * H) * dipo.covariance);
}

}  // namespace internal

inline std::vector<TwoOdometries::Frame> TwoOdometries::run(
    std::uint64_t seed, double duration_s,
    const std::vector<std::pair<double, double>>& vio_spans) const {
  Random random(seed);
  const Matrix6 Q_dipo = dt * diagonal(dipo_rotation_deg, dipo_position);
  const Matrix6 Q_vio = dt * diagonal(vio_rotation_deg, vio_position);
  const double own = std::sqrt(1.0 - shared_rotation * shared_rotation);
  Frame frame{0.0, SE3{}, {SE3{}, diagonal(0.2, 0.02)}, std::nullopt};
  frame.dipo.T_world_body = boxplus(frame.truth, -draw(random, frame.dipo.covariance));
  std::vector<Frame> frames;
  while (frame.t < duration_s) {
    const SE3 motion{so3::exp({0.02 * std::sin(frame.t), 0.0, 0.03 * std::cos(0.2 * frame.t)}),
                     {0.5 * dt, 0.0, 0.01 * std::sin(0.5 * frame.t)}};
    const Vector6 dipo_noise = draw(random, Q_dipo);
    Vector6 vio_noise = draw(random, Q_vio);
    vio_noise.head<3>() = own * vio_noise.head<3>() + shared_rotation * vio_rotation_deg /
                                                          dipo_rotation_deg * dipo_noise.head<3>();
    vio_noise(3) += speed_bias * dt;
    frame.t += dt;
    frame.truth = frame.truth * motion;
    frame.dipo = internal::reckon(frame.dipo, boxplus(motion, dipo_noise), Q_dipo);
    internal::measure(frame.dipo, frame.truth, random);
    bool there = false;
    for (const auto& [start, end] : vio_spans) there |= frame.t >= start && frame.t < end;
    if (!there) {
      frame.vio.reset();
    } else if (frame.vio) {
      frame.vio = internal::reckon(*frame.vio, boxplus(motion, vio_noise), Q_vio);
    } else {
      frame.vio = frame.dipo;
    }
    frames.push_back(frame);
  }
  return frames;
}

}  // namespace apvi::test
