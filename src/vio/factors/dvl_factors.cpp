// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Cholesky>

#include "apvi/core/error.hpp"
#include "vio/factors/block_math.hpp"
#include "vio/factors/corrected_delta.hpp"
#include "vio/factors/factors.hpp"

namespace apvi::vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using imu::Preintegration;

// Added to variances [m²], so that a noise-free displacement has a finite weight: (1 µm)².
constexpr double kVarianceFloor_m2 = 1e-12;

Matrix3d sqrt_information_of(const Matrix3d& covariance) {
  const Eigen::LLT<Matrix3d> llt(covariance + kVarianceFloor_m2 * Matrix3d::Identity());
  APVI_CHECK(llt.info() == Eigen::Success);
  return llt.matrixL().solve(Matrix3d::Identity());
}

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

DvlVelocityFactor::DvlVelocityFactor(const DvlPing& ping, const SE3& T_body_dvl,
                                     const Vector3d& gravity, const FirstEstimate* first)
    : ping_(ping), T_body_dvl_(T_body_dvl), gravity_(gravity), first_(first) {}

bool DvlVelocityFactor::Evaluate(double const* const* parameters, double* residuals,
                                 double** jacobians) const {
  const Vector3d& lever = T_body_dvl_.translation;
  const Matrix3d S_dvl_body =
      ping_.sqrt_information * T_body_dvl_.rotation.toRotationMatrix().transpose();
  const PingMotion now(ping_, gravity_, parameters[0], MotionView(parameters[1]));
  Eigen::Map<Vector3d>{residuals} = S_dvl_body * (now.velocity + now.angular_rate.cross(lever)) -
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
    write_ping_motion(jacobians[1], at, S_dvl_body, ping_.since_frame->bias_jacobian(), lever);
  }
  return true;
}

DvlDisplacementFactor::DvlDisplacementFactor(const DvlDisplacement& measured,
                                             const FirstEstimate* first_i,
                                             const FirstEstimate* first_j)
    : measured_(measured),
      sqrt_information_(sqrt_information_of(measured.covariance)),
      first_i_(first_i),
      first_j_(first_j) {}

bool DvlDisplacementFactor::Evaluate(double const* const* parameters, double* residuals,
                                     double** jacobians) const {
  const Rigid i(parameters[0]);
  const MotionView motion(parameters[1]);
  const Vector3d p_i_j = i.R.transpose() * (ConstVector3(parameters[2]) - i.p);
  const Vector3d expected = measured_.displacement +
                            measured_.gyro_bias_jacobian * (motion.gyro_bias - measured_.gyro_bias);
  Eigen::Map<Vector3d>{residuals} = sqrt_information_ * (p_i_j - expected);
  if (jacobians == nullptr) return true;
  const Rigid at(pose_point(first_i_, parameters[0]));
  const Vector3d p_j(pose_point(first_j_, parameters[2]));
  const Matrix3d S_Rt = sqrt_information_ * at.R.transpose();
  if (jacobians[0] != nullptr) {
    PoseJacobian<3> J(jacobians[0]);
    J.leftCols<3>() = sqrt_information_ * so3::hat(at.R.transpose() * (p_j - at.p));
    J.middleCols<3>(3) = -S_Rt;
    J.col(6).setZero();
  }
  if (jacobians[1] != nullptr) {
    MotionJacobian<3> J(jacobians[1]);
    J.setZero();
    J.middleCols<3>(3) = -sqrt_information_ * measured_.gyro_bias_jacobian;
  }
  if (jacobians[2] != nullptr) {
    PoseJacobian<3> J(jacobians[2]);
    J.setZero();
    J.middleCols<3>(3) = S_Rt;
  }
  return true;
}

}  // namespace apvi::vio
