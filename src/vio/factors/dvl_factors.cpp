// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "vio/factors/block_math.hpp"
#include "vio/factors/corrected_delta.hpp"
#include "vio/factors/factors.hpp"

namespace apvi::vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using imu::Preintegration;

/// Motion at the ping predicted from the state of frame i.
struct PingMotion {
  CorrectedDelta delta;
  Matrix3d Rt;            ///< R_iᵀ
  Vector3d unforced;      ///< R_iᵀ (v_i + g T)
  Vector3d velocity;      ///< of the body, in its own frame at the ping
  Vector3d angular_rate;  ///< [rad/s]

  PingMotion(const DvlPing& ping, const Vector3d& gravity, const double* pose,
             const MotionView& motion)
      : delta(*ping.since_frame, motion.gyro_bias, motion.accel_bias),
        Rt(Eigen::Map<const Eigen::Quaterniond>(pose + 3).toRotationMatrix().transpose()),
        unforced(Rt * (motion.velocity + gravity * ping.since_frame->duration_s())),
        velocity(delta.R.transpose() * (unforced + delta.velocity)),
        angular_rate(ping.gyro - motion.gyro_bias) {}
};

void write_ping_motion(double* out, const PingMotion& at, const Matrix3d& by_body_velocity,
                       const Eigen::Matrix<double, 9, 6>& by_bias, const Vector3d& lever) {
  MotionJacobian<3> J(out);
  const Matrix3d by_frame_velocity = by_body_velocity * at.delta.R.transpose();
  constexpr int kV = Preintegration::kVelocity;
  J.leftCols<3>() = by_frame_velocity * at.Rt;
  J.middleCols<3>(3) =
      by_frame_velocity * by_bias.block<3, 3>(kV, 0) +
      by_body_velocity *
          (so3::hat(at.velocity) * at.delta.Jr * by_bias.topLeftCorner<3, 3>() + so3::hat(lever));
  J.rightCols<3>() = by_frame_velocity * by_bias.block<3, 3>(kV, 3);
}

}  // namespace

DvlVelocityFactor::DvlVelocityFactor(const DvlPing& ping, const Vector3d& gravity,
                                     const FirstEstimate* first)
    : ping_(ping), gravity_(gravity), first_(first) {}

bool DvlVelocityFactor::Evaluate(double const* const* parameters, double* residuals,
                                 double** jacobians) const {
  const Rigid dvl(parameters[2]);
  // The prediction is scaled, not the measurement: else a smaller scale would reduce its noise.
  const Matrix3d S = std::exp(-*parameters[3]) * ping_.sqrt_information;
  const Matrix3d S_dvl_body = S * dvl.R.transpose();
  const PingMotion now(ping_, gravity_, parameters[0], MotionView(parameters[1]));
  Eigen::Map<Vector3d>{residuals} = S_dvl_body * (now.velocity + now.angular_rate.cross(dvl.p)) -
                                    ping_.sqrt_information * ping_.velocity;
  if (jacobians == nullptr) return true;
  const PingMotion at(ping_, gravity_, pose_point(first_, parameters[0]),
                      MotionView(motion_point(first_, parameters[1])));
  if (jacobians[0] != nullptr) {
    PoseJacobian<3> J(jacobians[0]);
    J.leftCols<3>() = S_dvl_body * at.delta.R.transpose() * so3::hat(at.unforced);
    J.rightCols<4>().setZero();
  }
  if (jacobians[1] != nullptr) {
    write_ping_motion(jacobians[1], at, S_dvl_body, ping_.since_frame->bias_jacobian(), dvl.p);
  }
  const Vector3d velocity = dvl.R.transpose() * (at.velocity + at.angular_rate.cross(dvl.p));
  if (jacobians[2] != nullptr) {
    PoseJacobian<3> J(jacobians[2]);
    J.leftCols<3>() = S * so3::hat(velocity);
    J.middleCols<3>(3) = S_dvl_body * so3::hat(at.angular_rate);
    J.col(6).setZero();
  }
  if (jacobians[3] != nullptr) {
    Eigen::Map<Vector3d>{jacobians[3]} = -S * ping_.predicted.value_or(velocity);
  }
  return true;
}

}  // namespace apvi::vio
