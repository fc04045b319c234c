// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/relative_filter.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "apvi/geometry/so3.hpp"

namespace apvi::fusion {
namespace {

using Eigen::Vector3d;

constexpr double kMinStep_s = 1e-6;  // for two frames with one stamp

Vector6 rotation_and_position(double rotation, double position) {
  Vector6 v;
  v << rotation, rotation, rotation, position, position, position;
  return v;
}

// Projection of a symmetric matrix onto the positive semidefinite matrices, in units of `scale`.
Eigen::Matrix3d positive_part(const Eigen::Matrix3d& m, const Eigen::Vector3d& scale) {
  const Eigen::Vector3d inverse = scale.cwiseInverse();
  const Eigen::Matrix3d scaled = inverse.asDiagonal() * m * inverse.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(0.5 * (scaled + scaled.transpose()));
  const Eigen::Matrix3d& V = solver.eigenvectors();
  const Eigen::Matrix3d kept = V * solver.eigenvalues().cwiseMax(0.0).asDiagonal() * V.transpose();
  return scale.asDiagonal() * kept * scale.asDiagonal();
}

// Upper limit of the common noise: the parallel sum, below either matrix.
Matrix6 common_noise(const Matrix6& a, const Matrix6& b) {
  return symmetric(a * (a + b).ldlt().solve(b));
}

// The error of an odometry after the same true motion, without linearization.
Vector6 propagate_error(const SE3& before, const SE3& now, const Vector6& error) {
  return boxminus(boxplus(before, error) * (before.inverse() * now), now);
}

// d(pose ⊞ error)/d(error) in the tangent at pose ⊞ error.
Matrix6 tangent_jacobian(const Vector6& error) {
  Matrix6 J = Matrix6::Identity();
  J.topLeftCorner<3, 3>() = so3::right_jacobian(error.head<3>());
  return J;
}

}  // namespace

Matrix6 error_transition(const SE3& before, const SE3& now) {
  const SE3 motion = before.inverse() * now;
  Matrix6 A = Matrix6::Identity();
  A.topLeftCorner<3, 3>() = motion.rotation.conjugate().toRotationMatrix();
  A.bottomLeftCorner<3, 3>() = -(before.rotation * so3::hat(motion.translation));
  return A;
}

void RandomWalkEstimator::add(const PoseEstimate& before, const PoseEstimate& now, double dt) {
  const Matrix6 A = error_transition(before.T_world_body, now.T_world_body);
  const Matrix6 predicted = now.covariance - A * before.covariance * A.transpose();
  const Vector3d up = now.T_world_body.rotation.conjugate() * Vector3d::UnitZ();
  const double weight = std::max(1.0 - std::exp(-dt / smoothing_s_), 1.0 / ++count_);
  rotation_ += weight * (up.dot(predicted.topLeftCorner<3, 3>() * up) / dt - rotation_);
  position_ += weight * (0.5 * (predicted(3, 3) + predicted(4, 4)) / dt - position_);
}

Matrix6 RandomWalkEstimator::noise(double dt) const {
  Vector6 variance;
  variance << Vector3d::Constant(std::max(rotation_, min_rotation_ * min_rotation_)),
      Vector3d::Constant(std::max(position_, min_position_ * min_position_));
  return (dt * variance).asDiagonal();
}

TiltHeightCorrection tilt_height_correction(const SE3& pose, const Matrix6& predicted,
                                            const Matrix6& measured) {
  Eigen::Matrix<double, 3, 6> H = Eigen::Matrix<double, 3, 6>::Zero();
  H.topLeftCorner<2, 3>() = pose.rotation.toRotationMatrix().topRows<2>();
  H(2, 5) = 1.0;
  const Eigen::Matrix3d before = H * predicted * H.transpose();
  const Eigen::Matrix3d lost =
      positive_part(before - H * measured * H.transpose(), before.diagonal().cwiseSqrt());
  // The gain that yields the posterior `before - lost`, and the measurement noise R behind it: K =
  // P Hᵀ S^-1 with S^-1 = before^-1 lost before^-1, and K R Kᵀ = P Hᵀ (S^-1 - S^-1 before S^-1) H
  // P.
  const Eigen::Matrix3d inverse = before.inverse();
  const Eigen::Matrix3d S_inverse = inverse * lost * inverse;
  const Eigen::Matrix<double, 6, 3> PHt = predicted * H.transpose();
  const Matrix6 N = PHt * (S_inverse - S_inverse * before * S_inverse) * PHt.transpose();
  return {Matrix6::Identity() - PHt * S_inverse * H, symmetric(N)};
}

RelativeFilter::RelativeFilter(const RelativeConfig& config)
    : config_(config),
      dipo_walk_(config.drift_smoothing_s, config.min_rotation_walk_deg_sqrt_s * kRadiansPerDegree,
                 config.min_position_walk_m_sqrt_s),
      vio_walk_(dipo_walk_) {}

void RelativeFilter::step(Stamp stamp, const PoseEstimate& dipo,
                          const std::optional<VioPose>& vio) {
  nis_.reset();
  if (dipo_) {
    predict(std::max(kMinStep_s, seconds_between(stamp_, stamp)), dipo, vio);
  } else {
    mean_.setZero();
    covariance_.setZero();
    covariance_.topLeftCorner<6, 6>() = dipo.covariance;
  }
  stamp_ = stamp;
  dipo_ = dipo;
  const bool continues = vio && vio_;
  vio_.reset();
  if (!vio) return;
  if (continues) update(*vio);
  if (!continues || nis_.value_or(0.0) > config_.nis_gate) clone(*vio);
  vio_ = vio->pose;
}

Matrix6 RelativeFilter::vio_noise(double dt, const VioPose& vio) {
  vio_walk_.add(*vio_, vio.pose, dt);
  if (!vio.random_walk_per_s) return vio_walk_.noise(dt);
  const Matrix6 min_noise =
      RandomWalkEstimator(1.0, config_.min_rotation_walk_deg_sqrt_s * kRadiansPerDegree,
                          config_.min_position_walk_m_sqrt_s)
          .noise(dt);
  return symmetric(dt * *vio.random_walk_per_s) + min_noise;
}

void RelativeFilter::predict(double dt, const PoseEstimate& dipo,
                             const std::optional<VioPose>& vio) {
  const SE3& before = dipo_->T_world_body;
  const SE3& now = dipo.T_world_body;
  const Matrix6 A = error_transition(before, now);
  dipo_walk_.add(*dipo_, dipo, dt);
  const Matrix6 noise = dipo_walk_.noise(dt);
  const Matrix6 predicted = symmetric(A * dipo_->covariance * A.transpose() + noise);
  const TiltHeightCorrection correction = tilt_height_correction(now, predicted, dipo.covariance);
  const Matrix6& G = correction.G;
  Matrix12 F = Matrix12::Identity();
  Matrix12 Q = Matrix12::Zero();
  F.topLeftCorner<6, 6>() = G * A;
  Q.topLeftCorner<6, 6>() = G * noise * G.transpose() + correction.N;
  mean_.head<6>() = G * propagate_error(before, now, mean_.head<6>());
  if (vio && vio_) {
    const Matrix6 vio_walk = vio_noise(dt, *vio);
    const Matrix6 shared = config_.shared_noise_fraction * G * common_noise(noise, vio_walk);
    F.bottomRightCorner<6, 6>() = error_transition(vio_->T_world_body, vio->pose.T_world_body);
    Q.bottomRightCorner<6, 6>() = vio_walk;
    Q.topRightCorner<6, 6>() = shared;
    Q.bottomLeftCorner<6, 6>() = shared.transpose();
    mean_.tail<6>() = propagate_error(vio_->T_world_body, vio->pose.T_world_body, mean_.tail<6>());
  }
  covariance_ = F * covariance_ * F.transpose() + Q;
  covariance_ = 0.5 * (covariance_ + covariance_.transpose()).eval();
}

void RelativeFilter::clone(const VioPose& vio) {
  const SE3 best = boxplus(dipo_->T_world_body, mean_.head<6>());
  mean_.tail<6>() = boxminus(best, vio.pose.T_world_body);
  const Matrix6 J =
      tangent_jacobian(mean_.tail<6>()).partialPivLu().solve(tangent_jacobian(mean_.head<6>()));
  const Matrix6 P = covariance_.topLeftCorner<6, 6>();
  covariance_.bottomLeftCorner<6, 6>() = J * P;
  covariance_.topRightCorner<6, 6>() = P * J.transpose();
  covariance_.bottomRightCorner<6, 6>() = J * P * J.transpose();
}

void RelativeFilter::update(const VioPose& vio) {
  const auto& U = vio.directions.basis;
  const SE3 by_dipo = boxplus(dipo_->T_world_body, mean_.head<6>());
  const SE3 by_vio = boxplus(vio.pose.T_world_body, mean_.tail<6>());
  Eigen::Matrix<double, 6, 12> whole;
  whole << tangent_jacobian(mean_.head<6>()), -tangent_jacobian(mean_.tail<6>());
  const Eigen::MatrixXd H = U.transpose() * whole;
  const Vector6 tie =
      rotation_and_position(config_.pose_noise_deg * kRadiansPerDegree, config_.pose_noise_m)
          .cwiseAbs2();
  const Eigen::MatrixXd R = U.transpose() * tie.asDiagonal() * U;
  const Eigen::VectorXd r = U.transpose() * boxminus(by_vio, by_dipo);
  const Eigen::LDLT<Eigen::MatrixXd> S(H * covariance_ * H.transpose() + R);
  nis_ = r.dot(S.solve(r));
  if (!(*nis_ <= config_.nis_gate)) return;
  const Eigen::MatrixXd K = S.solve(H * covariance_).transpose();
  mean_ += K * r;
  const Matrix12 I_KH = Matrix12::Identity() - K * H;  // Joseph form
  covariance_ = I_KH * covariance_ * I_KH.transpose() + K * R * K.transpose();
}

PoseEstimate RelativeFilter::estimate() const {
  const Matrix6 J = tangent_jacobian(mean_.head<6>());
  const Matrix6 P = covariance_.topLeftCorner<6, 6>();
  return {boxplus(dipo_->T_world_body, mean_.head<6>()), symmetric(J * P * J.transpose())};
}

}  // namespace apvi::fusion
