// SPDX-License-Identifier: BSD-3-Clause
#include "sensors/camera_mask.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "apvi/core/error.hpp"
#include "sensors/reduced_camera.hpp"

namespace apvi {

cv::Mat read_mask(const std::filesystem::path& file) {
  const cv::Mat image = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
  if (image.empty()) fail_run("{}: cannot be read as an image", file.string());
  double brightest = 0.0;
  cv::minMaxLoc(image, nullptr, &brightest);
  return image > 0.5 * brightest;
}

std::optional<std::filesystem::path> find_mask(const std::filesystem::path& folder,
                                               const std::filesystem::path& image) {
  std::filesystem::path with_png = image;
  with_png += ".png";
  std::filesystem::path as_png = image;
  as_png.replace_extension(".png");
  for (const std::filesystem::path& name : {image, with_png, as_png}) {
    std::error_code unreadable;
    if (std::filesystem::is_regular_file(folder / name, unreadable)) return folder / name;
  }
  return std::nullopt;
}

cv::Mat load_camera_mask(const std::filesystem::path& file, const CameraModel& camera) {
  if (!std::filesystem::exists(file)) fail_input("{}: no such file", file.string());
  cv::Mat mask = read_mask(file);
  const CameraModel::Parameters& p = camera.parameters();
  if (mask.cols != p.width || mask.rows != p.height) {
    fail_input("{}: {} x {} pixels, but the camera has {} x {}", file.string(), mask.cols,
               mask.rows, p.width, p.height);
  }
  const int shown = cv::countNonZero(mask);
  if (shown == 0) fail_input("{}: all black: it hides everything", file.string());
  if (shown == mask.rows * mask.cols) {
    fail_input("{}: nothing is black: it hides nothing", file.string());
  }
  return mask;
}

cv::Mat combined(const cv::Mat& a, const cv::Mat& b) {
  if (a.empty()) return b;
  if (b.empty()) return a;
  if (a.size() != b.size()) {
    fail_run("a mask is {} x {}, but that of the camera {} x {}", b.cols, b.rows, a.cols, a.rows);
  }
  return a & b;
}

cv::Mat reduced_mask(const cv::Mat& mask, int by, int margin_px) {
  if (mask.empty()) return {};
  cv::Mat small = reduced(mask, by) == 255;  // all pixels of a block
  if (margin_px > 0) {
    const int side = 2 * margin_px + 1;
    cv::erode(small, small, cv::Mat::ones(side, side, CV_8U), cv::Point(-1, -1), 1,
              cv::BORDER_CONSTANT, cv::Scalar(255));
  }
  return small;
}

bool is_hidden(const cv::Mat& mask, const cv::Point2f& pixel) {
  if (mask.empty()) return false;
  const int x = std::clamp(static_cast<int>(std::lround(pixel.x)), 0, mask.cols - 1);
  const int y = std::clamp(static_cast<int>(std::lround(pixel.y)), 0, mask.rows - 1);
  return mask.at<unsigned char>(y, x) == 0;
}

void resolve_masks(config::Node& rig, const std::filesystem::path& file) {
  for (auto& [key, section] : rig.members) {
    if (!key.starts_with("cam") || section.kind != config::Node::Kind::map) continue;
    for (auto& [name, value] : section.members) {
      if (name != "mask" || value.kind != config::Node::Kind::scalar || value.text.empty())
        continue;
      value.text =
          std::filesystem::absolute(file.parent_path() / value.text).lexically_normal().string();
    }
  }
}

}  // namespace apvi
