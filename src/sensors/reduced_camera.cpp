// SPDX-License-Identifier: BSD-3-Clause
#include "sensors/reduced_camera.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "sensors/camera_mask.hpp"

namespace apvi {

int reduction_of(const CameraModel& camera, int max_side_px) {
  const int side = std::max(camera.parameters().width, camera.parameters().height);
  return std::max(1, (side + max_side_px - 1) / max_side_px);
}

// The center of the top-left pixel is (0, 0), so its edge is at -0.5 in either image.
CameraModel reduced(const CameraModel& camera, int by) {
  CameraModel::Parameters p = camera.parameters();
  p.fx /= by;
  p.fy /= by;
  p.cx = (p.cx + 0.5) / by - 0.5;
  p.cy = (p.cy + 0.5) / by - 0.5;
  p.width /= by;
  p.height /= by;
  return CameraModel(p);
}

cv::Mat reduced(const cv::Mat& image, int by) {
  if (by == 1) return image;
  const cv::Size size(image.cols / by, image.rows / by);
  cv::Mat out;
  cv::resize(image({0, 0, size.width * by, size.height * by}), out, size, 0.0, 0.0, cv::INTER_AREA);
  return out;
}

Rig reduced(Rig rig, int max_side_px) {
  for (CameraCalibration& camera : rig.cameras) {
    const int by = reduction_of(camera.model, max_side_px);
    camera.model = reduced(camera.model, by);
    camera.mask = reduced_mask(camera.mask, by, 0);
  }
  return rig;
}

}  // namespace apvi
