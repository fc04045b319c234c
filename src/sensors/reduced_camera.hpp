// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>

#include "apvi/sensors/rig.hpp"

/// Reduced images and their cameras: a pixel is the mean over `by` x `by` pixels of the recorded
/// image, whose last rows and columns are cut off if they fill no pixel.
namespace apvi {

/// The smallest whole number by which images are divided so that their longer side is at most
/// `max_side_px`.
int reduction_of(const CameraModel& camera, int max_side_px);
/// The camera of images reduced `by` a whole number.
CameraModel reduced(const CameraModel& camera, int by);
/// An image reduced `by` a whole number; the image itself for 1.
cv::Mat reduced(const cv::Mat& image, int by);
/// The rig with the cameras of images reduced to `max_side_px`.
Rig reduced(Rig rig, int max_side_px);

}  // namespace apvi
