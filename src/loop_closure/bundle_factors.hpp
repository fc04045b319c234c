// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/autodiff_cost_function.h>

#include <Eigen/Geometry>

#include "apvi/geometry/se3.hpp"
#include "loop_closure/bundle_adjustment.hpp"
#include "sensors/lens_change.hpp"

/// Errors of a bundle adjustment in sigmas. A pose is a rotation (unit quaternion as Eigen stores
/// it) and a position [m] of the camera in the world.
namespace apvi::loop_closure {

template <typename T>
Eigen::Matrix<T, 3, 1> position_of(const T* position) {
  return Eigen::Map<const Eigen::Matrix<T, 3, 1>>(position);
}

template <typename T>
Eigen::Quaternion<T> rotation_of(const T* rotation) {
  return Eigen::Map<const Eigen::Quaternion<T>>(rotation);
}

/// Twice the vector part of a small rotation: its rotation vector to first order.
template <typename T>
Eigen::Matrix<T, 3, 1> small_rotation(const Eigen::Quaternion<T>& q) {
  return (q.w() < T(0.0) ? T(-2.0) : T(2.0)) * q.vec();
}

inline constexpr double kMinDepth_m = 1e-3;  // before the camera

/// A point of the world in the camera of a view.
template <typename T>
Eigen::Matrix<T, 3, 1> in_camera(const T* rotation, const T* position, const T* R_body_camera,
                                 const T* p_body_camera, const T* point) {
  const Eigen::Matrix<T, 3, 1> in_body =
      rotation_of(rotation).conjugate() * (position_of(point) - position_of(position));
  return rotation_of(R_body_camera).conjugate() * (in_body - position_of(p_body_camera));
}

/// Of a ray on the plane z = 1. Lens: the change from that of the rig, see lens_change.hpp.
struct RayFactor {
  Eigen::Vector2d ray;  ///< by the rig's lens
  DistortionByLens distortion;
  double sigma = 1.0;

  static ceres::CostFunction* create(const RayFactor& factor) {
    return new ceres::AutoDiffCostFunction<RayFactor, 2, 4, 3, 4, 3, 3, 3>(new RayFactor(factor));
  }
  template <typename T>
  bool operator()(const T* rotation, const T* position, const T* R_body_camera,
                  const T* p_body_camera, const T* lens, const T* point, T* error) const {
    const Eigen::Matrix<T, 3, 1> p =
        in_camera(rotation, position, R_body_camera, p_body_camera, point);
    if (p.z() < T(kMinDepth_m)) return false;
    Eigen::Map<Eigen::Matrix<T, 2, 1>> e(error);
    e = (rig_point<T>(p.hnormalized(), distortion, lens) - ray.cast<T>()) / T(sigma);
    return true;
  }
};

/// Of the motion from one view to another, along the axes of the world of odometry.
struct MotionFactor {
  ViewMotion motion;
  Eigen::Quaterniond R_odometry_before;

  static ceres::CostFunction* create(const ViewMotion& motion,
                                     const Eigen::Quaterniond& R_odometry_before) {
    return new ceres::AutoDiffCostFunction<MotionFactor, 6, 4, 3, 4, 3>(
        new MotionFactor{motion, R_odometry_before});
  }
  template <typename T>
  bool operator()(const T* rotation_a, const T* position_a, const T* rotation_b,
                  const T* position_b, T* error) const {
    const Eigen::Quaternion<T> R_a_world = rotation_of(rotation_a).conjugate();
    const Eigen::Quaternion<T> R_odometry = R_odometry_before.cast<T>();
    const Eigen::Matrix<T, 3, 1> moved =
        R_odometry * (R_a_world * (position_of(position_b) - position_of(position_a)) -
                      motion.T_before_this.translation.cast<T>());
    const Eigen::Matrix<T, 3, 1> turned = small_rotation<T>(
        R_odometry * R_a_world * rotation_of(rotation_b) *
        motion.T_before_this.rotation.conjugate().cast<T>() * R_odometry.conjugate());
    Eigen::Map<Eigen::Matrix<T, 6, 1>> e(error);
    e << moved.template head<2>() / T(motion.sigmas.horizontal_m),
        moved.z() / T(motion.sigmas.vertical_m), turned / T(motion.sigmas.heading_rad);
    return true;
  }
};

/// Of the direction of gravity in the camera.
struct TiltFactor {
  Eigen::Vector3d up;  ///< in the camera
  double sigma = 1.0;  ///< [rad]

  static ceres::CostFunction* create(const Eigen::Vector3d& up, double sigma) {
    return new ceres::AutoDiffCostFunction<TiltFactor, 3, 4>(new TiltFactor{up, sigma});
  }
  template <typename T>
  bool operator()(const T* rotation, T* error) const {
    Eigen::Map<Eigen::Matrix<T, 3, 1>> e(error);
    e = (rotation_of(rotation).conjugate() * Eigen::Vector3d::UnitZ().cast<T>() - up.cast<T>()) /
        T(sigma);
    return true;
  }
};

struct ViewHeightFactor {
  ViewHeight height;

  static ceres::CostFunction* create(const ViewHeight& height) {
    return new ceres::AutoDiffCostFunction<ViewHeightFactor, 1, 3>(new ViewHeightFactor{height});
  }
  template <typename T>
  bool operator()(const T* position, T* error) const {
    error[0] = (position[2] - T(height.z_m)) / T(height.sigma_m);
    return true;
  }
};

/// Of position and heading of the camera.
struct ViewPoseFactor {
  ViewPose pose;

  static ceres::CostFunction* create(const ViewPose& pose) {
    return new ceres::AutoDiffCostFunction<ViewPoseFactor, 4, 4, 3, 4, 3>(new ViewPoseFactor{pose});
  }
  template <typename T>
  bool operator()(const T* rotation, const T* position, const T* R_body_camera,
                  const T* p_body_camera, T* error) const {
    const Eigen::Matrix<T, 3, 1> moved = position_of(position) +
                                         rotation_of(rotation) * position_of(p_body_camera) -
                                         pose.T_world_camera.translation.cast<T>();
    const Eigen::Matrix<T, 3, 1> turned =
        small_rotation<T>(rotation_of(rotation) * rotation_of(R_body_camera) *
                          pose.T_world_camera.rotation.conjugate().cast<T>());
    Eigen::Map<Eigen::Matrix<T, 4, 1>> e(error);
    e << moved.template head<2>() / T(pose.sigmas.horizontal_m),
        moved.z() / T(pose.sigmas.vertical_m), turned.z() / T(pose.sigmas.heading_rad);
    return true;
  }
};

/// Of a rotation about a value.
struct RotationFactor {
  Eigen::Quaterniond value;
  double sigma = 1.0;

  static ceres::CostFunction* create(const Eigen::Quaterniond& value, double sigma) {
    return new ceres::AutoDiffCostFunction<RotationFactor, 3, 4>(new RotationFactor{value, sigma});
  }
  template <typename T>
  bool operator()(const T* rotation, T* error) const {
    Eigen::Map<Eigen::Matrix<T, 3, 1>> e(error);
    e = small_rotation<T>(value.conjugate().cast<T>() * rotation_of(rotation)) / T(sigma);
    return true;
  }
};

/// Of three values that should be the given ones.
struct VectorFactor {
  Eigen::Vector3d value;
  Eigen::Vector3d sigmas;

  static ceres::CostFunction* create(const Eigen::Vector3d& value, const Eigen::Vector3d& sigmas) {
    return new ceres::AutoDiffCostFunction<VectorFactor, 3, 3>(new VectorFactor{value, sigmas});
  }
  template <typename T>
  bool operator()(const T* values, T* error) const {
    for (int i = 0; i < 3; ++i) error[i] = (values[i] - T(value[i])) / T(sigmas[i]);
    return true;
  }
};

}  // namespace apvi::loop_closure
