// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "apvi/geometry/so3.hpp"
#include "apvi/sensors/rig.hpp"
#include "core/random.hpp"
#include "vio/frontend/tracker.hpp"

/// Walls with a random texture, imaged by a camera with lens distortion; the origin of every pixel
/// is known.
namespace apvi::test {

/// A wall at z = distance, between two values of x [m].
struct Wall {
  double distance = 6.0;
  double left = -1e9;
  double right = 1e9;
  std::array<double, 2> shift{};  ///< displacement in x and y [m]
};

inline cv::Mat random_texture(int size, std::uint64_t seed) {
  Random random(seed);
  cv::Mat texture = cv::Mat::zeros(size, size, CV_32F);
  for (const double sigma : {1.5, 4.0, 12.0}) {
    cv::Mat noise(size, size, CV_32F);
    for (int i = 0; i < size * size; ++i) {
      noise.at<float>(i / size, i % size) = static_cast<float>(random.normal());
    }
    cv::GaussianBlur(noise, noise, {}, sigma, sigma, cv::BORDER_REFLECT_101);
    texture += noise * (25.0 * 2.0 * sigma);  // similar contrast at every scale
  }
  cv::Mat gray;
  texture.convertTo(gray, CV_8U, 1.0, 120.0);
  return gray;
}

inline CameraCalibration small_camera() {
  CameraCalibration camera;
  camera.model = CameraModel(
      {300.0, 302.0, 238.0, 181.0, Distortion::radtan, {-0.12, 0.03, 2e-4, -1e-4}, 480, 360});
  // Body x forward, camera z forward, slightly misaligned.
  Eigen::Matrix3d R;
  R << 0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0;
  camera.T_body_camera.rotation =
      Eigen::Quaterniond(R) * so3::exp(Eigen::Vector3d(0.02, -0.03, 0.01));
  camera.T_body_camera.translation = {0.1, -0.05, 0.02};
  return camera;
}

class TexturedWorld {
 public:
  explicit TexturedWorld(std::vector<Wall> in_it) : walls(std::move(in_it)) {}

  /// The first wall hit by a ray from the camera, and the hit point.
  std::optional<std::pair<std::size_t, Eigen::Vector3d>> hit(const Eigen::Vector3d& from,
                                                             const Eigen::Vector3d& ray) const {
    std::optional<std::pair<std::size_t, Eigen::Vector3d>> nearest;
    for (std::size_t i = 0; i < walls.size(); ++i) {
      const double length = (walls[i].distance - from.z()) / ray.z();
      const Eigen::Vector3d p = from + length * ray;
      const double x = p.x() - walls[i].shift[0];
      if (ray.z() <= 1e-3 || length <= 0.0 || x < walls[i].left || x > walls[i].right) continue;
      if (!nearest || p.z() < nearest->second.z()) nearest = {i, p};
    }
    return nearest;
  }

  cv::Mat view(const CameraModel& camera, const SE3& T_world_camera) const {
    constexpr double kTexelsPerMeter = 80.0;
    const auto& p = camera.parameters();
    const std::vector<Eigen::Vector3d>& rays = rays_of(camera);
    const Eigen::Matrix3d R = T_world_camera.rotation.toRotationMatrix();
    cv::Mat map(p.height, p.width, CV_32FC2, cv::Scalar(-1.0, -1.0));
    for (int i = 0; i < p.width * p.height; ++i) {
      const Eigen::Vector3d ray = R * rays[static_cast<std::size_t>(i)];
      const auto found = hit(T_world_camera.translation, ray);
      if (!found) continue;
      const auto& [wall, point] = *found;
      const Eigen::Vector2d at =
          point.head<2>() - Eigen::Vector2d(walls[wall].shift[0], walls[wall].shift[1]);
      // A different part of the texture for each wall.
      const double u = kTexelsPerMeter * at.x() + 300.0 * static_cast<double>(wall);
      const double v = kTexelsPerMeter * at.y();
      map.at<cv::Vec2f>(i / p.width, i % p.width) = {static_cast<float>(wrapped(u)),
                                                     static_cast<float>(wrapped(v))};
    }
    cv::Mat image;
    cv::remap(texture, image, map, {}, cv::INTER_LINEAR, cv::BORDER_WRAP);
    return image;
  }

  /// Position of `pixel` of one camera in another view; nullopt if out of view.
  std::optional<Eigen::Vector2d> seen_again(const CameraModel& camera, const SE3& T_world_before,
                                            const Eigen::Vector2d& pixel,
                                            const CameraModel& camera_now,
                                            const SE3& T_world_now) const {
    const auto ray = camera.unproject(pixel);
    if (!ray) return std::nullopt;
    const auto found = hit(T_world_before.translation, T_world_before.rotation * *ray);
    if (!found) return std::nullopt;
    return camera_now.project(T_world_now.inverse() * found->second);
  }

  std::vector<Wall> walls;
  cv::Mat texture = random_texture(1024, 7);

 private:
  static double wrapped(double t) { return t - 1024.0 * std::floor(t / 1024.0); }

  // Zero where the lens model has no inverse. Cached per camera, identified by its focal length, as
  // they take longer to compute than the image.
  const std::vector<Eigen::Vector3d>& rays_of(const CameraModel& camera) const {
    const auto& p = camera.parameters();
    auto& rays = rays_[p.fx];
    if (!rays.empty()) return rays;
    for (int i = 0; i < p.width * p.height; ++i) {
      rays.push_back(
          camera.unproject({i % p.width, i / p.width}).value_or(Eigen::Vector3d::Zero()));
    }
    return rays;
  }

  mutable std::map<double, std::vector<Eigen::Vector3d>> rays_;
};

/// A far wall and a nearer one that occludes its right half.
inline TexturedWorld two_walls() {
  return TexturedWorld({Wall{6.0, -1e9, 1e9, {}}, Wall{3.5, 0.2, 1e9, {}}});
}

inline Stamp frame_stamp(int k) {
  return Stamp{1'000'000'000 + 50'000'000LL * k};
}

/// A camera that drifts sideways, approaches and rotates slightly.
inline SE3 swaying_pose(int k) {
  const double t = 0.05 * k;
  return {so3::exp(Eigen::Vector3d(0.05 * std::sin(2.0 * t), 0.08 * std::sin(1.5 * t), 0.1 * t)),
          Eigen::Vector3d(0.5 * t, 0.15 * std::sin(3.0 * t), 0.3 * t)};
}

/// Rotation of the body between two camera poses, from the current to the previous frame, as a gyro
/// measures it.
inline Eigen::Quaterniond body_turn(const CameraCalibration& camera, const SE3& T_world_before,
                                    const SE3& T_world_now) {
  const Eigen::Quaterniond& R = camera.T_body_camera.rotation;
  return R * T_world_before.rotation.conjugate() * T_world_now.rotation * R.conjugate();
}

/// Feeds a tracker with images along `swaying_pose`.
class Dive {
 public:
  explicit Dive(TexturedWorld seen, const vio::TrackerConfig& config = {},
                const CameraCalibration& camera_used = small_camera())
      : world(std::move(seen)), camera(camera_used), tracker(config, {camera}) {}

  cv::Mat image(int k) const { return world.view(camera.model, swaying_pose(k)); }
  std::optional<Eigen::Quaterniond> turn(int from, int to) const {
    if (from < 0) return std::nullopt;
    return body_turn(camera, swaying_pose(from), swaying_pose(to));
  }
  vio::TrackedFrame frame(int k) { return frame(k, image(k)); }
  vio::TrackedFrame frame(int k, const cv::Mat& image) {
    auto tracked = tracker.process({image}, frame_stamp(k), turn(before_, k));
    before_ = k;
    return tracked;
  }
  /// Processes the next frames and returns the last result.
  vio::TrackedFrame frames(int from, int to) {
    vio::TrackedFrame last;
    for (int k = from; k < to; ++k) last = frame(k);
    return last;
  }

  TexturedWorld world;
  CameraCalibration camera;
  vio::Tracker tracker;

 private:
  int before_ = -1;
};

}  // namespace apvi::test
