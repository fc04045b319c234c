// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <opencv2/core/mat.hpp>
#include <optional>

#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/splat/lamp.hpp"
#include "apvi/splat/view.hpp"

/// Between the two halves: Eigen and OpenCV here, LibTorch there. OpenCV has the centre of the
/// top-left pixel at (0, 0), `splat` at (0.5, 0.5).
namespace apvi::bridge {

/// The pinhole of a camera model without its distortion.
splat::Intrinsics to_intrinsics(const CameraModel::Parameters& camera);
/// A camera without distortion.
CameraModel::Parameters to_parameters(const splat::Intrinsics& intrinsics);

/// The rig's lamp as its first camera has it; nothing when it has none of the two.
std::optional<splat::Lamp> lamp_of(const Rig& rig);

/// [4,4] float64, and back (the rotation made orthonormal).
torch::Tensor to_tensor(const SE3& pose);
SE3 to_se3(const torch::Tensor& matrix);

/// 8-bit grey or BGR to uint8 RGB [H,W,3].
torch::Tensor to_tensor(const cv::Mat& image);
/// RGB [H,W,3], float in [0, 1] (clamped) or uint8, to 8-bit BGR.
cv::Mat to_image(const torch::Tensor& image);

/// Turns pictures of a camera into pictures of a pinhole.
///
/// The pinhole keeps the camera's focal lengths and centre, so that the middle of the picture keeps
/// its resolution; where that would show what the lens never saw (pincushion distortion), it is
/// narrowed until it does not. Then the whole is reduced by `scale`.
class Undistorter {
 public:
  /// Throws InputError when `scale` leaves less than one pixel or the lens model has no inverse.
  Undistorter(const CameraModel& camera, double scale);

  const splat::Intrinsics& intrinsics() const { return intrinsics_; }
  /// Throws RunError when the picture's size is not the camera's.
  cv::Mat operator()(const cv::Mat& image) const;
  /// The same without mixing neighbours: for depth.
  cv::Mat nearest(const cv::Mat& image) const;

 private:
  cv::Mat apply(const cv::Mat& image, int remap_by, int resize_by) const;

  cv::Size source_;
  cv::Mat map_x_, map_y_;  // empty without distortion
  splat::Intrinsics intrinsics_;
};

}  // namespace apvi::bridge
