// SPDX-License-Identifier: BSD-3-Clause
#include "vio/frontend/frame_image.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <opencv2/video/tracking.hpp>

#include "sensors/reduced_camera.hpp"

namespace apvi::vio {
namespace {

bool to_eight_bit(const cv::Mat& image, cv::Mat& out) {
  switch (image.depth()) {
    case CV_8U:
      out = image;
      return true;
    case CV_16U:
      image.convertTo(out, CV_8U, 1.0 / 256.0);
      return true;
    case CV_32F:
      image.convertTo(out, CV_8U, 255.0);
      return true;
    default:
      return false;
  }
}

}  // namespace

int flow_levels(cv::Size image) {
  const double side = std::max(image.width, image.height);
  return std::max(3, static_cast<int>(std::lround(std::log2(side / 80.0))));
}

bool to_gray(const cv::Mat& image, cv::Mat& gray) {
  cv::Mat eight_bit;
  if (image.empty() || image.dims != 2 || !to_eight_bit(image, eight_bit)) return false;
  switch (image.channels()) {
    case 1:
      eight_bit.copyTo(gray);  // the caller may overwrite the image
      return true;
    case 3:
      cv::cvtColor(eight_bit, gray, cv::COLOR_BGR2GRAY);
      return true;
    case 4:
      cv::cvtColor(eight_bit, gray, cv::COLOR_BGRA2GRAY);
      return true;
    default:
      return false;
  }
}

FramePreparer::FramePreparer(bool equalize)
    : clahe_(equalize ? cv::createCLAHE(3.0, cv::Size(8, 8)) : nullptr) {}

bool FramePreparer::load(const cv::Mat& image, cv::Size size, FrameImage& frame, int by,
                         const cv::Mat& mask) {
  if (image.size() != size || !to_gray(reduced(image, by), frame.gray)) return false;
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(frame.gray, mean, deviation, mask);
  frame.brightness = mean[0];
  frame.contrast = deviation[0];
  return true;
}

void FramePreparer::build_pyramid(FrameImage& frame) const {
  if (clahe_) {
    clahe_->apply(frame.gray, frame.equalized);
  } else {
    frame.equalized = frame.gray;
  }
  // Derivatives are computed once for three searches: forward, backward, and forward again as the
  // previous frame.
  cv::buildOpticalFlowPyramid(frame.equalized, frame.pyramid, cv::Size(kFlowWindow, kFlowWindow),
                              flow_levels(frame.equalized.size()), true, cv::BORDER_REFLECT_101,
                              cv::BORDER_CONSTANT, false);
}

bool identical(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size() || a.type() != b.type()) return false;
  const std::size_t bytes = static_cast<std::size_t>(a.cols) * a.elemSize();
  for (int row = 0; row < a.rows; ++row) {
    if (std::memcmp(a.ptr(row), b.ptr(row), bytes) != 0) return false;
  }
  return true;
}

}  // namespace apvi::vio
