// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>

#include "apvi/geometry/so3.hpp"
#include "apvi/loop/place.hpp"

/// A flat floor of random patches of every size at z = 0, as a camera above sees it.
namespace apvi::test {

inline constexpr double kFloorPixels = 100.0;  // a metre of the texture
inline constexpr int kFloorSize = 2000;        // of the texture, in its middle the origin [px]

inline loop::Pinhole floor_camera() {
  return {.fx = 210.0, .fy = 210.0, .cx = 160.0, .cy = 120.0, .width = 320, .height = 240};
}

/// Octaves of noise. The seed is fixed.
inline const cv::Mat& floor_texture() {
  static const cv::Mat texture = [] {
    cv::RNG random(7);
    cv::Mat sum = cv::Mat::zeros(kFloorSize, kFloorSize, CV_32F);
    for (int octave = 0; octave < 6; ++octave) {
      const int size = kFloorSize >> octave;
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

/// T_world_camera of a camera that looks down, its picture's upper edge towards `heading`.
inline SE3 looking_down(const Eigen::Vector3d& position, double heading) {
  Eigen::Matrix3d down;
  down << 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0;
  return {so3::exp({0.0, 0.0, heading}) * Eigen::Quaterniond(down), position};
}

/// 8-bit grey.
inline cv::Mat picture_of_floor(const SE3& T_world_camera) {
  const loop::Pinhole camera = floor_camera();
  Eigen::Matrix3d K;
  K << camera.fx, 0.0, camera.cx - 0.5, 0.0, camera.fy, camera.cy - 0.5, 0.0, 0.0, 1.0;
  const SE3 T_camera_world = T_world_camera.inverse();
  Eigen::Matrix3d plane;  // from the floor's x, y, 1 to the camera
  plane.leftCols<2>() = T_camera_world.rotation.toRotationMatrix().leftCols<2>();
  plane.col(2) = T_camera_world.translation;
  Eigen::Matrix3d metres;
  metres << 1.0 / kFloorPixels, 0.0, -0.5 * kFloorSize / kFloorPixels, 0.0, 1.0 / kFloorPixels,
      -0.5 * kFloorSize / kFloorPixels, 0.0, 0.0, 1.0;
  const Eigen::Matrix3d H = K * plane * metres;
  cv::Mat homography;
  cv::eigen2cv(H, homography);
  cv::Mat picture;
  cv::warpPerspective(floor_texture(), picture, homography, {camera.width, camera.height});
  return picture;
}

}  // namespace apvi::test
