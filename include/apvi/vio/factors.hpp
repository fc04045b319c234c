// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/manifold.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>
#include <memory>

#include "apvi/imu/preintegration.hpp"
#include "apvi/vio/frame_state.hpp"

/// Terms of the sliding window. Every Jacobian is written by hand and compared with numeric
/// differences in tests/vio. Where a `FirstEstimate` is given, derivatives are taken at it, the
/// residual at the state; the pointer must outlive the factor and may be null.
namespace apvi::vio {

/// The tangent of PoseBlock. Jacobians of cost functions are by the tangent already, so the
/// Jacobian of Plus is the identity over a row of zeros.
class PoseManifold final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return kPoseSize; }
  int TangentSize() const override { return kPoseTangent; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

/// A landmark seen by two frames of one camera (the paper's visual term): anchored in frame i at
/// `point_i` with inverse depth λ = 1/z there, seen at `point_j` in frame j. Blocks: pose i, pose
/// j, T_body_camera (a pose), λ [1/m], time offset of the camera [s] (true time = stamp - offset;
/// the points move by their velocities).
class ReprojectionFactor final : public ceres::SizedCostFunction<2, 7, 7, 7, 1, 1> {
 public:
  struct View {
    Eigen::Vector2d point;     ///< on the plane z = 1
    Eigen::Vector2d velocity;  ///< of it [1/s]
  };
  /// `weight`: 1 / sigma on the plane z = 1. `offset_s`: the time offset that was taken off
  /// already.
  ReprojectionFactor(const View& i, const View& j, double weight, double offset_s,
                     const FirstEstimate* first_i, const FirstEstimate* first_j);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  View i_, j_;
  double weight_, offset_s_;
  const FirstEstimate* first_i_;
  const FirstEstimate* first_j_;
};

/// The same with frame j seen by another camera. Blocks: pose i, pose j, T_body_camera of the
/// anchor's camera, T_body_camera of the other, λ, time offset.
class CrossCameraFactor final : public ceres::SizedCostFunction<2, 7, 7, 7, 7, 1, 1> {
 public:
  using View = ReprojectionFactor::View;
  CrossCameraFactor(const View& i, const View& j, double weight, double offset_s,
                    const FirstEstimate* first_i, const FirstEstimate* first_j);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  View i_, j_;
  double weight_, offset_s_;
  const FirstEstimate* first_i_;
  const FirstEstimate* first_j_;
};

/// The same within one frame. Blocks: T_body_camera of the anchor's camera, of the other, λ.
class StereoFactor final : public ceres::SizedCostFunction<2, 7, 7, 1> {
 public:
  StereoFactor(const Eigen::Vector2d& point_a, const Eigen::Vector2d& point_b, double weight);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector2d a_, b_;
  double weight_;
};

/// Inertial motion between two frames (Forster et al., T-RO 2017, Eq. 45). Blocks: pose i, motion
/// i, pose j, motion j. Residual in the order of imu::Preintegration, whitened by its covariance.
class ImuFactor final : public ceres::SizedCostFunction<15, 7, 9, 7, 9> {
 public:
  ImuFactor(std::shared_ptr<const imu::Preintegration> preintegration,
            const Eigen::Vector3d& gravity, const FirstEstimate* first_i,
            const FirstEstimate* first_j);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  std::shared_ptr<const imu::Preintegration> delta_;
  Eigen::Vector3d gravity_;
  Eigen::Matrix<double, 15, 15> sqrt_information_;
  const FirstEstimate* first_i_;
  const FirstEstimate* first_j_;
};

/// A DVL ping between frames: the velocity that the inertial motion since frame i predicts at the
/// ping, seen from the DVL. Blocks: pose i, motion i. Never sees yaw or position.
struct DvlPing {
  std::shared_ptr<const imu::Preintegration> since_frame;  ///< from frame i to the ping
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();          ///< at the ping, with its bias [rad/s]
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();      ///< true velocity of the DVL, DVL frame
  Eigen::Matrix3d sqrt_information = Eigen::Matrix3d::Identity();  ///< [s/m]
};
class DvlVelocityFactor final : public ceres::SizedCostFunction<3, 7, 9> {
 public:
  DvlVelocityFactor(const DvlPing& ping, const SE3& T_body_dvl, const Eigen::Vector3d& gravity,
                    const FirstEstimate* first);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  DvlPing ping_;
  SE3 T_body_dvl_;
  Eigen::Vector3d gravity_;
  const FirstEstimate* first_;
};

/// Distance travelled between two frames as the DVL and the gyro measure it:
/// Δp = R_iᵀ (p_j - p_i), first order in the gyro bias.
struct DvlDisplacement {
  Eigen::Vector3d displacement =
      Eigen::Vector3d::Zero();  ///< of the body, in the frame of body i [m]
  Eigen::Matrix3d gyro_bias_jacobian = Eigen::Matrix3d::Zero();  ///< d displacement / d gyro bias
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();           ///< it was summed up with
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();          ///< [m²]
};
/// Blocks: pose i, motion i, pose j.
class DvlDisplacementFactor final : public ceres::SizedCostFunction<3, 7, 9, 7> {
 public:
  DvlDisplacementFactor(const DvlDisplacement& measured, const FirstEstimate* first_i,
                        const FirstEstimate* first_j);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  DvlDisplacement measured_;
  Eigen::Matrix3d sqrt_information_;
  const FirstEstimate* first_i_;
  const FirstEstimate* first_j_;
};

/// Depth as measured at a frame. Blocks: pose; depth that is measured where the world has z = 0
/// [m], which nobody knows better than the first samples tell. `sign` as Rig::depth_sign.
class DepthFactor final : public ceres::SizedCostFunction<1, 7, 1> {
 public:
  DepthFactor(double depth_m, double sigma_m, const Eigen::Vector3d& p_body_sensor, double sign,
              const FirstEstimate* first);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  double depth_m_, sigma_m_;
  Eigen::Vector3d p_body_sensor_;
  double sign_;
  const FirstEstimate* first_;
};

/// A pose known from elsewhere. Residual: [rotation, position], sqrt information by the tangent.
class PosePriorFactor final : public ceres::SizedCostFunction<6, 7> {
 public:
  PosePriorFactor(const SE3& pose, const Eigen::Matrix<double, 6, 6>& sqrt_information);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  SE3 pose_;
  Eigen::Matrix<double, 6, 6> sqrt_information_;
};

/// Velocity and biases known from elsewhere. Residual in the order of MotionBlock.
class MotionPriorFactor final : public ceres::SizedCostFunction<9, 9> {
 public:
  MotionPriorFactor(const MotionBlock& motion, const Eigen::Matrix<double, 9, 9>& sqrt_information);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  MotionBlock motion_;
  Eigen::Matrix<double, 9, 9> sqrt_information_;
};

}  // namespace apvi::vio
