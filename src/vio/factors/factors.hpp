// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/manifold.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>
#include <memory>
#include <optional>

#include "imu/preintegration.hpp"
#include "vio/window/frame_state.hpp"

/// Cost functions of the sliding window. All Jacobians are analytic and are compared with numeric
/// differences in tests/vio. If a `FirstEstimate` is given, Jacobians are evaluated at it and
/// residuals at the current state; the pointer may be null and must outlive the factor.
namespace apvi::vio {

/// Manifold of PoseBlock. Jacobians of the cost functions are already by the tangent, so the
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

/// Reprojection of a landmark between two frames of one camera (the visual term of the paper):
/// anchored in frame i at `point_i` with inverse depth λ = 1/z, observed at `point_j` in frame j.
/// Blocks: pose i, pose j, T_body_camera (a pose), λ [1/m], time offset of the camera [s] (true
/// time = stamp - offset; between image and frame the body moves as `motion` says), lens
/// correction.
class ReprojectionFactor final : public ceres::SizedCostFunction<2, 7, 7, 7, 1, 1, 3> {
 public:
  struct View {
    Eigen::Vector2d point;  ///< on the plane z = 1, by the rig's lens
    ImageMotion motion = {};
  };
  /// `weight`: 1 / sigma on the plane z = 1.
  ReprojectionFactor(const View& i, const View& j, double weight, const FirstEstimate* first_i,
                     const FirstEstimate* first_j);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  View i_, j_;
  double weight_;
  const FirstEstimate* first_i_;
  const FirstEstimate* first_j_;
};

/// As ReprojectionFactor, but frame j is observed by another camera. Blocks: pose i, pose j,
/// T_body_camera of the anchor camera, T_body_camera of the other camera, λ, time offset, lens
/// corrections of the two.
class CrossCameraFactor final : public ceres::SizedCostFunction<2, 7, 7, 7, 7, 1, 1, 3, 3> {
 public:
  using View = ReprojectionFactor::View;
  CrossCameraFactor(const View& i, const View& j, double weight, const FirstEstimate* first_i,
                    const FirstEstimate* first_j);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  View i_, j_;
  double weight_;
  const FirstEstimate* first_i_;
  const FirstEstimate* first_j_;
};

/// As CrossCameraFactor, within one frame. Blocks: T_body_camera of the anchor camera, of the other
/// camera, λ, lens corrections of the two.
class StereoFactor final : public ceres::SizedCostFunction<2, 7, 7, 1, 3, 3> {
 public:
  StereoFactor(const Eigen::Vector2d& point_a, const Eigen::Vector2d& point_b, double weight);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector2d a_, b_;
  double weight_;
};

/// Preintegrated inertial motion between two frames (Forster et al., T-RO 2017, Eq. 45). Blocks:
/// pose i, motion i, pose j, motion j. The residual has the order of imu::Preintegration and is
/// whitened by its covariance.
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

/// A DVL ping between frames: the velocity predicted from frame i by inertial propagation, in the
/// DVL frame. Blocks: pose i, motion i, T_body_dvl, scale correction: logarithm of the true over
/// the given velocity. Independent of yaw and position.
struct DvlPing {
  std::shared_ptr<const imu::Preintegration> since_frame;  ///< from frame i to the ping
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();  ///< at the ping, not bias-corrected [rad/s]
  Eigen::Vector3d velocity =
      Eigen::Vector3d::Zero();  ///< velocity of the DVL, in the DVL frame [m/s]
  Eigen::Matrix3d sqrt_information = Eigen::Matrix3d::Identity();  ///< [s/m]
  /// Velocity as predicted before the ping, in the DVL frame [m/s]: where the Jacobian by the scale
  /// is evaluated. At an estimate that contains the ping's noise, noise would look like scale.
  std::optional<Eigen::Vector3d> predicted = std::nullopt;
};
class DvlVelocityFactor final : public ceres::SizedCostFunction<3, 7, 9, 7, 1> {
 public:
  DvlVelocityFactor(const DvlPing& ping, const Eigen::Vector3d& gravity,
                    const FirstEstimate* first);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  DvlPing ping_;
  Eigen::Vector3d gravity_;
  const FirstEstimate* first_;
};

/// Pressure depth at a frame. Blocks: pose; measured depth at z = 0 of the world [m], a free
/// offset. `sign` as Rig::down_sign.
class PressureDepthFactor final : public ceres::SizedCostFunction<1, 7, 1> {
 public:
  PressureDepthFactor(double depth_m, double sigma_m, const Eigen::Vector3d& p_body_sensor,
                      double sign, const FirstEstimate* first);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  double depth_m_, sigma_m_;
  Eigen::Vector3d p_body_sensor_;
  double sign_;
  const FirstEstimate* first_;
};

/// Prior on a pose. Residual: [rotation, position]; square-root information in the tangent.
class PosePriorFactor final : public ceres::SizedCostFunction<6, 7> {
 public:
  PosePriorFactor(const SE3& pose, const Eigen::Matrix<double, 6, 6>& sqrt_information);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  SE3 pose_;
  Eigen::Matrix<double, 6, 6> sqrt_information_;
};

/// Prior on velocity and biases. Residual in the order of MotionBlock.
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
