// SPDX-License-Identifier: BSD-3-Clause
#include "dipo/eskf.hpp"

#include <Eigen/Cholesky>

#include "apvi/geometry/so3.hpp"

namespace apvi::dipo {

using imu::kNavSize;

State boxplus(const State& state, const Vector& delta) {
  State out = state;
  out.nav = imu::boxplus(state.nav, delta.head<kNavSize>());
  out.dvl_time_offset_s += delta(kTimeOffset);
  out.dvl_scale_error += delta(kScale);
  out.R_body_dvl = (state.R_body_dvl * so3::exp(delta.segment<3>(kMounting))).normalized();
  out.p_body_dvl += delta.segment<3>(kLeverArm);
  out.depth_bias_m += delta(kDepthBias);
  out.p_last_ping += delta.segment<3>(kLastPing);
  return out;
}

void Eskf::propagate(const Eigen::Vector3d& gyro, const Eigen::Vector3d& accel, double dt,
                     const imu::EarthModel& world, const imu::Noise& noise,
                     const CalibrationRandomWalk& walk) {
  constexpr int kRest = kSize - kNavSize;
  imu::NavMatrix F;
  state_.nav = imu::propagate(state_.nav, gyro, accel, dt, world, F);
  // The calibration has no dynamics: only the blocks affected by the motion are computed.
  P_.topLeftCorner<kNavSize, kNavSize>() =
      F * P_.topLeftCorner<kNavSize, kNavSize>() * F.transpose() + imu::process_noise(F, noise, dt);
  P_.topRightCorner<kNavSize, kRest>() = F * P_.topRightCorner<kNavSize, kRest>().eval();
  P_.bottomLeftCorner<kRest, kNavSize>() = P_.topRightCorner<kNavSize, kRest>().transpose();
  const auto add = [&](int index, int count, double density) {
    P_.diagonal().segment(index, count).array() += density * density * dt;
  };
  add(kTimeOffset, 1, walk.time_offset);
  add(kScale, 1, walk.scale);
  add(kMounting, 3, walk.mounting);
  add(kLeverArm, 3, walk.lever_arm);
  add(kDepthBias, 1, walk.depth_bias);
}

void Eskf::coast(double dt, const CoastUncertainty& uncertainty) {
  imu::NavMatrix F = imu::NavMatrix::Identity();
  const Eigen::Matrix3d R = state_.nav.R_world_body.toRotationMatrix();
  F.block<3, 3>(imu::kPosition, imu::kTheta) = -dt * R * so3::hat(state_.nav.v_body);
  F.block<3, 3>(imu::kPosition, imu::kVelocity) = dt * R;
  state_.nav.p_world += dt * (R * state_.nav.v_body);
  P_.topRows<kNavSize>() = F * P_.topRows<kNavSize>().eval();
  P_.leftCols<kNavSize>() = P_.leftCols<kNavSize>().eval() * F.transpose();
  const double turn = uncertainty.turn * uncertainty.turn;
  const double speed = uncertainty.speed_change * uncertainty.speed_change;
  inflate(imu::kTheta, 3, turn);
  inflate(imu::kVelocity, 3, speed);
  inflate(imu::kPosition, 3, (speed + turn * state_.nav.v_body.squaredNorm()) * dt * dt);
}

double Eskf::nis(const Measurement& m) const {
  const Measurement::Covariance S = m.H * P_ * m.H.transpose() + m.R;
  return m.residual.dot(S.ldlt().solve(m.residual));
}

void Eskf::update(const Measurement& m) {
  using Gain = Eigen::Matrix<double, kSize, Eigen::Dynamic, 0, kSize, Measurement::kMaxRows>;
  const Gain PHt = P_ * m.H.transpose();
  const Measurement::Covariance S = m.H * PHt + m.R;
  const Gain K = S.ldlt().solve(PHt.transpose()).transpose();
  const Vector delta = K * m.residual;
  state_ = boxplus(state_, delta);

  // The Joseph form keeps P symmetric and positive semidefinite: (I - KH) P (I - KH)ᵀ + K R Kᵀ.
  const Matrix I_KH = Matrix::Identity() - K * m.H;
  P_ = I_KH * P_ * I_KH.transpose() + K * m.R * K.transpose();

  // Reset of the error state (Sola, Eq. 287), for attitude and mounting.
  Matrix G = Matrix::Identity();
  G.block<3, 3>(imu::kTheta, imu::kTheta) = so3::right_jacobian(delta.segment<3>(imu::kTheta));
  G.block<3, 3>(kMounting, kMounting) = so3::right_jacobian(delta.segment<3>(kMounting));
  P_ = G * P_ * G.transpose();
  P_ = 0.5 * (P_ + P_.transpose()).eval();
}

void Eskf::inflate(int index, int count, double variance) {
  P_.diagonal().segment(index, count).array() += variance;
}

void Eskf::clone_position() {
  state_.p_last_ping = state_.nav.p_world;
  P_.middleRows<3>(kLastPing) = P_.middleRows<3>(imu::kPosition).eval();
  P_.middleCols<3>(kLastPing) = P_.middleCols<3>(imu::kPosition).eval();
}

}  // namespace apvi::dipo
