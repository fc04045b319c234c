// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "apvi/sensors/rig.hpp"
#include "gaussians/render/view.hpp"
#include "medium/lamp.hpp"

/// Conversions between Eigen/OpenCV types and LibTorch tensors. The center of the top-left pixel is
/// (0, 0) in OpenCV and (0.5, 0.5) in `gaussians`.
namespace apvi::slam {

/// Intrinsics of a camera model, ignoring its distortion.
gaussians::Intrinsics to_intrinsics(const CameraModel::Parameters& camera);
/// Parameters of a camera without distortion.
CameraModel::Parameters to_parameters(const gaussians::Intrinsics& intrinsics);

/// The rig's lamps in the frame of its first camera; none when there is no camera.
std::vector<medium::Lamp> lamps_of(const Rig& rig);

/// Pose to a [4,4] float64 matrix and back (the rotation is orthonormalized).
torch::Tensor to_tensor(const SE3& pose);
SE3 to_se3(const torch::Tensor& matrix);

/// 8-bit gray or BGR to uint8 RGB [H,W,3].
torch::Tensor to_tensor(const cv::Mat& image);
/// A mask as in CameraCalibration, bool [H,W]; undefined if it is empty.
torch::Tensor scene_of(const cv::Mat& mask);
/// The reverse.
cv::Mat mask_of(const torch::Tensor& scene);
/// RGB [H,W,3], float in [0, 1] (clamped) or uint8, to 8-bit BGR.
cv::Mat to_image(const torch::Tensor& image);

/// Undistorts images of a camera to a pinhole camera.
///
/// The pinhole keeps the camera's focal lengths and principal point, so that the image center keeps
/// its resolution; if it then covers pixels outside the camera's image (pincushion distortion), its
/// focal lengths are increased until it does not. The result is scaled by `scale`.
class Undistorter {
 public:
  /// Throws InputError when `scale` leaves less than one pixel or the lens model has no inverse.
  Undistorter(const CameraModel& camera, double scale);

  const gaussians::Intrinsics& intrinsics() const { return intrinsics_; }
  /// Throws RunError when the image's size is not the camera's.
  cv::Mat operator()(const cv::Mat& image) const;
  /// With nearest-neighbor interpolation, for depth images.
  cv::Mat nearest(const cv::Mat& image) const;
  /// A mask of the camera's images as one of the undistorted images: a pixel is the scene if all
  /// that it is interpolated from is. Empty if that of the camera is.
  cv::Mat mask(const cv::Mat& mask) const;

 private:
  cv::Mat apply(const cv::Mat& image, int remap_by, int resize_by) const;

  cv::Size source_;
  cv::Mat map_x_, map_y_;  // empty without distortion
  gaussians::Intrinsics intrinsics_;
};

}  // namespace apvi::slam
