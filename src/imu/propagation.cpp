// SPDX-License-Identifier: BSD-3-Clause
#include "imu/propagation.hpp"

#include "apvi/geometry/so3.hpp"

namespace apvi::imu {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// Intermediate values shared by the propagation and its Jacobian.
struct Step {
  Vector3d earth_body;  // Earth's rate in the body frame at the start
  Vector3d phi;         // rotation of the step
  Vector3d force;       // specific force without bias
  Quaterniond R_mid;
  Vector3d v_world;
  NavState next;
};

Step integrate_step(const NavState& x, const Vector3d& gyro, const Vector3d& accel, double dt,
                    const EarthModel& world) {
  Step s;
  s.earth_body = x.R_world_body.conjugate() * world.earth_rate;
  s.phi = (gyro - x.gyro_bias - s.earth_body) * dt;
  s.force = accel - x.accel_bias;
  s.R_mid = x.R_world_body * so3::exp(0.5 * s.phi);
  s.v_world = x.R_world_body * x.v_body;
  const Vector3d acceleration =
      s.R_mid * s.force + world.gravity - 2.0 * world.earth_rate.cross(s.v_world);
  const Vector3d v_next = s.v_world + acceleration * dt;
  s.next = x;
  s.next.R_world_body = (x.R_world_body * so3::exp(s.phi)).normalized();
  s.next.p_world += 0.5 * dt * (s.v_world + v_next);
  s.next.v_body = s.next.R_world_body.conjugate() * v_next;
  return s;
}

}  // namespace

NavState boxplus(const NavState& state, const NavVector& delta) {
  NavState out = state;
  out.R_world_body = (state.R_world_body * so3::exp(delta.segment<3>(kTheta))).normalized();
  out.p_world += delta.segment<3>(kPosition);
  out.v_body += delta.segment<3>(kVelocity);
  out.gyro_bias += delta.segment<3>(kGyroBias);
  out.accel_bias += delta.segment<3>(kAccelBias);
  return out;
}

NavVector boxminus(const NavState& a, const NavState& b) {
  NavVector d;
  d << so3::log(b.R_world_body.conjugate() * a.R_world_body), a.p_world - b.p_world,
      a.v_body - b.v_body, a.gyro_bias - b.gyro_bias, a.accel_bias - b.accel_bias;
  return d;
}

NavState propagate(const NavState& state, const Vector3d& gyro, const Vector3d& accel, double dt,
                   const EarthModel& world) {
  return integrate_step(state, gyro, accel, dt, world).next;
}

NavState propagate(const NavState& state, const Vector3d& gyro, const Vector3d& accel, double dt,
                   const EarthModel& world, NavMatrix& F) {
  const Step s = integrate_step(state, gyro, accel, dt, world);
  const Matrix3d R = state.R_world_body.toRotationMatrix();
  const Matrix3d R_mid = s.R_mid.toRotationMatrix();
  const Matrix3d R_next_t = s.next.R_world_body.conjugate().toRotationMatrix();

  // φ depends on θ through the Earth rate in the body frame, and on the gyro bias.
  const Matrix3d phi_theta = -dt * so3::hat(s.earth_body);
  const Matrix3d jr = so3::right_jacobian(s.phi);
  const Matrix3d theta_theta = so3::exp(-s.phi).toRotationMatrix() + jr * phi_theta;
  const Matrix3d theta_bg = -dt * jr;

  // Mid-step orientation, which rotates the specific force.
  const Matrix3d jr_half = so3::right_jacobian(0.5 * s.phi);
  const Matrix3d mid_theta = so3::exp(-0.5 * s.phi).toRotationMatrix() + 0.5 * jr_half * phi_theta;
  const Matrix3d force_mid = -R_mid * so3::hat(s.force);

  // Velocity in world coordinates, before and after the step.
  const Matrix3d coriolis = Matrix3d::Identity() - 2.0 * dt * so3::hat(world.earth_rate);
  const Matrix3d v_theta = -R * so3::hat(state.v_body);
  const Matrix3d next_theta = coriolis * v_theta + dt * force_mid * mid_theta;
  const Matrix3d next_v = coriolis * R;
  const Matrix3d next_bg = dt * force_mid * (-0.5 * dt * jr_half);
  const Matrix3d next_ba = -dt * R_mid;
  const Matrix3d v_hat = so3::hat(s.next.v_body);

  F.setIdentity();
  F.block<3, 3>(kTheta, kTheta) = theta_theta;
  F.block<3, 3>(kTheta, kGyroBias) = theta_bg;
  F.block<3, 3>(kPosition, kTheta) = 0.5 * dt * (v_theta + next_theta);
  F.block<3, 3>(kPosition, kVelocity) = 0.5 * dt * (R + next_v);
  F.block<3, 3>(kPosition, kGyroBias) = 0.5 * dt * next_bg;
  F.block<3, 3>(kPosition, kAccelBias) = 0.5 * dt * next_ba;
  F.block<3, 3>(kVelocity, kTheta) = R_next_t * next_theta + v_hat * theta_theta;
  F.block<3, 3>(kVelocity, kVelocity) = R_next_t * next_v;
  F.block<3, 3>(kVelocity, kGyroBias) = R_next_t * next_bg + v_hat * theta_bg;
  F.block<3, 3>(kVelocity, kAccelBias) = R_next_t * next_ba;
  return s.next;
}

NavMatrix process_noise(const NavMatrix& F, const Noise& noise, double dt) {
  // White noise of density σ, held over dt, has variance σ²/dt and acts as minus a bias does.
  Eigen::Matrix<double, 9, 3> from_gyro = F.block<9, 3>(0, kGyroBias);
  Eigen::Matrix<double, 9, 3> from_accel = F.block<9, 3>(0, kAccelBias);
  NavMatrix Q = NavMatrix::Zero();
  Q.topLeftCorner<9, 9>() = (noise.gyro * noise.gyro / dt) * from_gyro * from_gyro.transpose() +
                            (noise.accel * noise.accel / dt) * from_accel * from_accel.transpose();
  Q.diagonal().segment<3>(kGyroBias).array() += noise.gyro_walk * noise.gyro_walk * dt;
  Q.diagonal().segment<3>(kAccelBias).array() += noise.accel_walk * noise.accel_walk * dt;
  return Q;
}

}  // namespace apvi::imu
