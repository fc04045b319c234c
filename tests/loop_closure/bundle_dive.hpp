// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <random>
#include <vector>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "loop_closure/bundle_adjustment.hpp"
#include "support/textured_floor.hpp"

/// A dive over points on rough ground, with features that are known.
namespace apvi::loop_closure {

inline constexpr double kFocal = 210.0;
inline constexpr double kNoise_px = 0.2;

struct BundleDive {
  std::vector<SE3> truth;  ///< of the body
  SE3 T_body_camera;
  std::vector<Place> places;
  std::vector<BundleView> views;  ///< point to `places`
};

inline SE3 small_motion(std::mt19937& random, double meters, double radians) {
  std::normal_distribution<double> gauss(0.0, 1.0);
  const auto draw = [&] { return Eigen::Vector3d(gauss(random), gauss(random), gauss(random)); };
  return {so3::exp(radians * draw()), meters * draw()};
}

/// Three lines of 4 m over each other's edge, 2 m above the ground, 0.4 m from view to view.
inline std::vector<SE3> survey_path() {
  std::vector<SE3> path;
  for (int line = 0; line < 3; ++line) {
    for (int step = 0; step <= 10; ++step) {
      const double x = line % 2 == 0 ? 0.4 * step : 4.0 - 0.4 * step;
      const double heading = line % 2 == 0 ? 0.0 : std::numbers::pi;
      path.push_back({so3::exp({0.02 * std::sin(step), 0.03 * std::cos(2 * step), heading}),
                      {x, 0.9 * line, 2.0 + 0.1 * std::sin(step)}});
    }
  }
  return path;
}

/// A camera that looks down, 10 cm before the body.
inline SE3 mounting() {
  return {so3::exp({std::numbers::pi, 0.0, 0.0}), {0.1, 0.0, -0.05}};
}

/// Every point has a descriptor of its own.
inline cv::Mat descriptor_of(std::size_t point) {
  cv::RNG random(1000 + point);
  cv::Mat descriptor(1, kDescriptorSize, CV_8U);
  random.fill(descriptor, cv::RNG::UNIFORM, 0, 90);
  return descriptor;
}

inline std::vector<Eigen::Vector3d> rough_ground(std::size_t count) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> x(-2.0, 6.0), y(-2.0, 4.0), z(-0.6, 0.6);
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < count; ++i) points.emplace_back(x(random), y(random), z(random));
  return points;
}

/// What a camera sees of the points. `scale`: of its focal length over that of the rig.
inline Place place_at(const std::vector<Eigen::Vector3d>& points, const SE3& T_world_camera,
                      std::mt19937& random, double scale = 1.0) {
  std::normal_distribution<double> noise(0.0, kNoise_px / kFocal);
  const CameraModel camera = test::floor_camera();
  const SE3 T_camera_world = T_world_camera.inverse();
  Place place;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d p = T_camera_world * points[i];
    const auto pixel = camera.project(p);
    if (!pixel || !camera.in_image(*pixel)) continue;
    place.rays.emplace_back(scale * p.hnormalized() +
                            Eigen::Vector2d(noise(random), noise(random)));
    place.points.emplace_back(p);
    place.descriptors.push_back(descriptor_of(i));
  }
  return place;
}

/// With odometry that drifts by 5 mm and 0.05 degrees from view to view.
inline BundleDive bundle_dive(double focal_scale = 1.0, const SE3& rig_error = SE3::identity()) {
  BundleDive dive;
  std::mt19937 random(11);
  dive.truth = survey_path();
  dive.T_body_camera = mounting();
  const auto points = rough_ground(1500);
  for (const SE3& body : dive.truth) {
    dive.places.push_back(place_at(points, body * mounting(), random, focal_scale));
  }
  SE3 odometry = dive.truth.front();
  for (std::size_t k = 0; k < dive.truth.size(); ++k) {
    BundleView view;
    if (k > 0) {
      const SE3 motion = dive.truth[k - 1].inverse() * dive.truth[k] *
                         small_motion(random, 0.005, 0.05 * kRadiansPerDegree);
      odometry = odometry * motion;
      view.motion = ViewMotion{
          motion,
          {.heading_rad = 0.05 * kRadiansPerDegree, .horizontal_m = 0.005, .vertical_m = 0.005}};
    }
    view.place = &dive.places[k];
    view.T_world_body = odometry;
    view.T_odometry_body = {dive.truth[k].rotation, odometry.translation};
    dive.views.push_back(view);
  }
  dive.T_body_camera = dive.T_body_camera * rig_error;
  return dive;
}

inline BundleOptions options_of(const BundleDive& dive) {
  return {.ray_sigma = 1.0 / kFocal,
          .T_body_camera = dive.T_body_camera,
          .prior = {.T_body_camera = dive.T_body_camera,
                    .mounting_rad = 0.02,
                    .lever_arm_m = 0.01,
                    .focal_length = 0.01,
                    .principal_point = 0.01}};
}

inline std::vector<SE3> cameras_of(const std::vector<SE3>& bodies, const SE3& T_body_camera) {
  std::vector<SE3> cameras;
  for (const SE3& body : bodies) cameras.push_back(body * T_body_camera);
  return cameras;
}

/// How poses differ from the truth once they are aligned to it.
struct PathError {
  double shape_m = 0.0;  ///< RMS, after an alignment with scale
  double scale = 1.0;    ///< of the truth over that of the poses
};

inline PathError path_error(const std::vector<SE3>& truth, const std::vector<SE3>& poses) {
  const auto size = static_cast<Eigen::Index>(truth.size());
  Eigen::Matrix3Xd from(3, size);
  Eigen::Matrix3Xd to(3, size);
  for (Eigen::Index k = 0; k < size; ++k) {
    from.col(k) = poses[static_cast<std::size_t>(k)].translation;
    to.col(k) = truth[static_cast<std::size_t>(k)].translation;
  }
  const Eigen::Matrix4d T = Eigen::umeyama(from, to, true);
  const Eigen::Matrix3Xd moved =
      (T.topLeftCorner<3, 3>() * from).colwise() + T.topRightCorner<3, 1>();
  return {(moved - to).norm() / std::sqrt(static_cast<double>(size)),
          std::cbrt(T.topLeftCorner<3, 3>().determinant())};
}

inline std::vector<SE3> start_of(const BundleDive& dive) {
  std::vector<SE3> poses;
  for (const BundleView& view : dive.views) poses.push_back(view.T_world_body);
  return poses;
}

}  // namespace apvi::loop_closure
