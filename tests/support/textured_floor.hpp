// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>

#include "apvi/geometry/se3.hpp"
#include "apvi/geometry/so3.hpp"
#include "apvi/sensors/camera_model.hpp"

/// A flat textured floor at z = 0 and its images from above.
namespace apvi::test {

inline constexpr double kFloorPixelsPerMeter = 100.0;  // texture resolution
inline constexpr int kFloorTextureSizePx = 2000;       // the origin is at its center

inline CameraModel floor_camera() {
  CameraModel::Parameters camera;
  camera.fx = camera.fy = 210.0;
  camera.cx = 159.5;
  camera.cy = 119.5;
  camera.width = 320;
  camera.height = 240;
  return CameraModel(camera);
}

/// Multi-octave noise with a fixed seed.
inline const cv::Mat& floor_texture() {
  static const cv::Mat texture = [] {
    cv::RNG random(7);
    cv::Mat sum = cv::Mat::zeros(kFloorTextureSizePx, kFloorTextureSizePx, CV_32F);
    for (int octave = 0; octave < 6; ++octave) {
      const int size = kFloorTextureSizePx >> octave;
      cv::Mat noise(size, size, CV_32F);
      random.fill(noise, cv::RNG::NORMAL, 0.0, 1.0);
      cv::resize(noise, noise, sum.size(), 0.0, 0.0, cv::INTER_CUBIC);
      sum += noise;
    }
    cv::Mat bytes;
    sum.convertTo(bytes, CV_8U, 18.0, 128.0);
    return bytes;
  }();
  return texture;
}

/// T_world_camera of a downward-looking camera whose image top points toward `heading`.
inline SE3 camera_looking_down(const Eigen::Vector3d& position, double heading) {
  Eigen::Matrix3d down;
  down << 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0;
  return {so3::exp({0.0, 0.0, heading}) * Eigen::Quaterniond(down), position};
}

/// 8-bit gray.
inline cv::Mat render_floor(const SE3& T_world_camera) {
  const CameraModel::Parameters camera = floor_camera().parameters();
  Eigen::Matrix3d K;
  K << camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0;
  const SE3 T_camera_world = T_world_camera.inverse();
  Eigen::Matrix3d plane;  // from the floor's x, y, 1 to the camera
  plane.leftCols<2>() = T_camera_world.rotation.toRotationMatrix().leftCols<2>();
  plane.col(2) = T_camera_world.translation;
  Eigen::Matrix3d T_texture_to_meters;
  T_texture_to_meters << 1.0 / kFloorPixelsPerMeter, 0.0,
      -0.5 * kFloorTextureSizePx / kFloorPixelsPerMeter, 0.0, 1.0 / kFloorPixelsPerMeter,
      -0.5 * kFloorTextureSizePx / kFloorPixelsPerMeter, 0.0, 0.0, 1.0;
  const Eigen::Matrix3d H = K * plane * T_texture_to_meters;
  cv::Mat homography;
  cv::eigen2cv(H, homography);
  cv::Mat image;
  cv::warpPerspective(floor_texture(), image, homography, {camera.width, camera.height});
  return image;
}

}  // namespace apvi::test
