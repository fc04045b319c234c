// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "loop_closure/place.hpp"
#include "loop_closure/pose_graph.hpp"

namespace apvi::loop_closure {

/// A measured motion of the body from the view before. Its sigmas are along the axes of the world
/// of odometry; that of heading is the one of every axis of rotation.
struct ViewMotion {
  SE3 T_before_this;
  EdgeSigmas sigmas;
};

/// A measured height of the body.
struct ViewHeight {
  double z_m = 0.0;
  double sigma_m = 0.0;
};

/// A measured pose of the camera, of which roll and pitch do not count.
struct ViewPose {
  SE3 T_world_camera;
  EdgeSigmas sigmas;
};

/// An image with a pose, and what other sensors say about it.
struct BundleView {
  const Place* place = nullptr;
  SE3 T_world_body;                  ///< where the adjustment begins
  SE3 T_odometry_body;               ///< its roll and pitch are a measurement
  double tilt_error = 0.0;           ///< of these, sigma beside that of every view [rad]
  std::optional<ViewMotion> motion;  ///< nothing for the first view
  std::optional<ViewHeight> height;
  std::vector<ViewPose> fixes;  ///< in a known map
};

/// The true lens, against that of the rig, with which the rays were computed.
struct LensCorrection {
  double scale = 1.0;                                ///< of the focal lengths
  Eigen::Vector2d offset = Eigen::Vector2d::Zero();  ///< of the principal point, in focal lengths
};

/// What is known about the camera before the adjustment: the rig, with standard deviations.
/// Nothing is estimated where these are zero.
struct CameraPrior {
  SE3 T_body_camera;
  double mounting_rad = 0.0;
  double lever_arm_m = 0.0;
  double focal_length = 0.0;     ///< relative
  double principal_point = 0.0;  ///< in focal lengths
};

/// What a bundle adjustment knows about the camera.
struct BundleCamera {
  SE3 T_body_camera;
  LensCorrection lens;
  /// Of the mounting (in the camera [rad]), the lever arm [m], the logarithm of the scale and the
  /// offset. Zero for what is not estimated.
  Eigen::Matrix<double, 9, 9> covariance = Eigen::Matrix<double, 9, 9>::Zero();
};

struct BundleOptions {
  double ray_sigma = 0.0;  ///< of a ray on the plane z = 1, at most
  SE3 T_body_camera;       ///< where the adjustment begins
  CameraPrior prior;
  std::function<void(int iteration)> progress = {};
};

struct BundleResult {
  std::vector<SE3> T_world_body;  ///< by view
  BundleCamera camera;
  std::size_t points = 0;
  std::size_t rays = 0;     ///< of these points
  double rms_before = 0.0;  ///< error of the rays, with points triangulated from the start
  double rms_after = 0.0;
};

/// Bundle adjustment (Triggs et al., "Bundle adjustment: a modern synthesis", 2000) of the places
/// of a dive: poses of the body and points from all features that match, with the motion of
/// odometry, its roll and pitch, and heights as further measurements. The mounting of the camera,
/// its focal length and its principal point are estimated too. `views` in order of time; `camera`
/// is that of the images. Deterministic, on the caller's thread. Nullopt if too few features match,
/// if they do not join neighboring views, or if the solver fails.
std::optional<BundleResult> adjust_bundle(const std::vector<BundleView>& views,
                                          const CameraModel& camera, const BundleOptions& options);

}  // namespace apvi::loop_closure
