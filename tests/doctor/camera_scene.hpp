// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <vector>

#include "doctor/camera_gyro_fit.hpp"
#include "geometry/spline.hpp"
#include "support/spline_imu.hpp"

/// Corners in pairs of images along a spline, projected in closed form, and the gyro of it.
namespace apvi::test {

using doctor::ImagePair;

struct CameraScene {
  Se3Spline spline = wavy_spline(3, 60.0);
  CameraModel::Parameters lens{
      400.0, 400.0, 319.5, 239.5, Distortion::radtan, {-0.2, 0.05, 0.0, 0.0}, 640, 480};
  SE3 T_body_camera{so3::exp({1.9, -0.4, 0.8}), {0.1, 0.05, -0.02}};
  double time_offset_s = 0.105;
  double noise_px = 0.3;
  double outliers = 0.1;  ///< fraction of corners that are anywhere
  bool is_flat = false;   ///< all corners on a plane before the camera
  std::function<void(ImuSample&)> change_imu = [](ImuSample&) {};

  SE3 camera_at(Stamp true_time) const { return spline.at(true_time).T_world_body * T_body_camera; }

  std::vector<ImuSample> imu() const {
    std::vector<ImuSample> samples = imu_along(spline, {0.0, 0.0, -9.80665}, 200.0);
    Random random(4);
    for (ImuSample& sample : samples) {
      sample.gyro += Eigen::Vector3d(0.01, -0.02, 0.015) + normal_vector(random, 0.002);
      change_imu(sample);
    }
    return samples;
  }

  std::vector<ImagePair> pairs() const {
    Random random(8);
    const CameraModel camera(lens);
    std::vector<ImagePair> pairs;
    for (double t = 1.0; t < 58.0; t += 0.3) {
      const Stamp before = spline.start() + Duration::from_seconds(t);
      pairs.push_back({before, before + Duration::from_seconds(0.3), {}});
      const Duration late = Duration::from_seconds(time_offset_s);
      const SE3 T_now_before =
          camera_at(pairs.back().now - late).inverse() * camera_at(before - late);
      while (pairs.back().points.size() < 50)
        add_corner(camera, T_now_before, pairs.back(), random);
    }
    for (ImagePair& pair : pairs) pair = doctor::without_outliers(pair);
    return pairs;
  }

 private:
  void add_corner(const CameraModel& camera, const SE3& T_now_before, ImagePair& pair,
                  Random& random) const {
    const auto pixel = [&] {
      return Eigen::Vector2d(random.uniform(0.0, lens.width), random.uniform(0.0, lens.height));
    };
    const Eigen::Vector2d before = pixel();
    const auto ray = camera.unproject(before);
    if (!ray) return;
    // The plane is tilted against the image.
    const double depth = is_flat ? 2.0 / (ray->z() - 0.4 * ray->y()) : random.uniform(1.0, 6.0);
    const auto now = camera.project(T_now_before * Eigen::Vector3d(depth * *ray));
    if (!now || !camera.in_image(*now)) return;
    const auto noise = [&] {
      return Eigen::Vector2d(random.normal(0.0, noise_px), random.normal(0.0, noise_px));
    };
    const bool is_outlier = random.uniform() < outliers;
    pair.points.push_back(
        {before + noise(), is_outlier ? pixel() : Eigen::Vector2d(*now + noise())});
  }
};

}  // namespace apvi::test
