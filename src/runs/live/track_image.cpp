// SPDX-License-Identifier: BSD-3-Clause
#include "runs/live/track_image.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "viewer/frame_image.hpp"
#include "viewer/message.hpp"

namespace apvi::runs {
namespace {

constexpr int kWidth = 480;

cv::Mat small_bgr(const cv::Mat& image) {
  const double scale = std::min(1.0, static_cast<double>(kWidth) / image.cols);
  cv::Mat out;
  cv::resize(image, out, {}, scale, scale, cv::INTER_AREA);
  if (out.channels() == 1) cv::cvtColor(out, out, cv::COLOR_GRAY2BGR);
  return out;
}

}  // namespace

std::string camera_image(const TrackImage& track) {
  const cv::Mat bgr = small_bgr(track.image);
  const double scale = static_cast<double>(bgr.cols) / track.image.cols;
  const SE3 T_camera_world = track.T_world_camera.inverse();
  for (const Eigen::Vector3d& point : track.points) {
    const auto pixel = track.camera.project(T_camera_world * point);
    if (!pixel) continue;
    cv::circle(bgr, {static_cast<int>(pixel->x() * scale), static_cast<int>(pixel->y() * scale)}, 3,
               {162, 192, 47}, 1, cv::LINE_AA);
  }
  const viewer::ImageHeader header{
      .kind = viewer::ImageKind::camera, .width = bgr.cols, .height = bgr.rows};
  return viewer::with_header(header, viewer::jpeg(bgr, 80));
}

}  // namespace apvi::runs
