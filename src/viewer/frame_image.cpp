// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/frame_image.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "apvi/core/error.hpp"

namespace apvi::viewer {
namespace {

constexpr float kOpaque = 0.5F;  // below it, a pixel shows no surface

// Depth at a fraction of the pixels with a surface, in order of depth.
float quantile(std::vector<float>& depths, double fraction) {
  const auto place = depths.begin() +
                     static_cast<std::ptrdiff_t>(fraction * static_cast<double>(depths.size() - 1));
  std::nth_element(depths.begin(), place, depths.end());
  return *place;
}

std::vector<float> surface_depths(const Rendering& r) {
  std::vector<float> depths;
  for (int y = 0; y < r.depth.rows; y += 2) {
    for (int x = 0; x < r.depth.cols; x += 2) {
      const float z = r.depth.at<float>(y, x);
      if (z > 0.0F && r.alpha.at<float>(y, x) > kOpaque) depths.push_back(z);
    }
  }
  return depths;
}

LayerImage depth_image(const Rendering& r) {
  LayerImage out{cv::Mat::zeros(r.depth.size(), CV_8UC3)};
  std::vector<float> depths = surface_depths(r);
  if (depths.empty()) return out;
  out.near_m = quantile(depths, 0.02);
  out.far_m = std::max(quantile(depths, 0.98), out.near_m * 1.01F);
  const double scale = 255.0 / (out.far_m - out.near_m);
  cv::Mat scaled;
  r.depth.convertTo(scaled, CV_8U, scale, -out.near_m * scale);
  cv::Mat colored;
  cv::applyColorMap(scaled, colored, cv::COLORMAP_TURBO);
  colored.copyTo(out.bgr, r.alpha > kOpaque);
  return out;
}

LayerImage alpha_image(const Rendering& r) {
  cv::Mat gray;
  r.alpha.convertTo(gray, CV_8U, 255.0);
  LayerImage out;
  cv::cvtColor(gray, out.bgr, cv::COLOR_GRAY2BGR);
  return out;
}

// Gradient of depth by pixels; the normal of z(u, v) seen by a pinhole is proportional to
// (f z_u, f z_v, -(z + u z_u + v z_v)), u and v from the principal point.
cv::Vec3b normal_color(float z, float z_u, float z_v, float u, float v, float focal) {
  cv::Vec3f n(focal * z_u, focal * z_v, -(z + u * z_u + v * z_v));
  n /= std::max(static_cast<float>(cv::norm(n)), 1e-9F);
  const auto byte = [](float x) { return cv::saturate_cast<uchar>(127.5F * (x + 1.0F)); };
  return {byte(-n[2]), byte(-n[1]), byte(n[0])};
}

LayerImage normal_image(const Rendering& r, double focal_px) {
  cv::Mat smooth, by_u, by_v;
  cv::GaussianBlur(r.depth, smooth, {}, 1.5);
  cv::Sobel(smooth, by_u, CV_32F, 1, 0, 3, 1.0 / 8.0);
  cv::Sobel(smooth, by_v, CV_32F, 0, 1, 3, 1.0 / 8.0);
  LayerImage out{cv::Mat::zeros(r.depth.size(), CV_8UC3)};
  const auto focal = static_cast<float>(focal_px);
  const float cx = 0.5F * static_cast<float>(r.depth.cols - 1);
  const float cy = 0.5F * static_cast<float>(r.depth.rows - 1);
  for (int y = 0; y < r.depth.rows; ++y) {
    for (int x = 0; x < r.depth.cols; ++x) {
      if (!(r.alpha.at<float>(y, x) > kOpaque)) continue;
      out.bgr.at<cv::Vec3b>(y, x) =
          normal_color(smooth.at<float>(y, x), by_u.at<float>(y, x), by_v.at<float>(y, x),
                       static_cast<float>(x) - cx, static_cast<float>(y) - cy, focal);
    }
  }
  return out;
}

std::string encoded(const cv::Mat& bgr, const char* extension, const std::vector<int>& options) {
  std::vector<uchar> bytes;
  if (!cv::imencode(extension, bgr, bytes, options)) fail_run("{}: cannot be encoded", extension);
  return {bytes.begin(), bytes.end()};
}

}  // namespace

LayerImage layer_image(const Rendering& rendering, Layer layer, double focal_px) {
  switch (layer) {
    case Layer::depth:
      return depth_image(rendering);
    case Layer::alpha:
      return alpha_image(rendering);
    case Layer::normals:
      return normal_image(rendering, focal_px);
    case Layer::seen:
    case Layer::restored:
      break;
  }
  return {.bgr = rendering.color};
}

std::string jpeg(const cv::Mat& bgr, int quality) {
  return encoded(bgr, ".jpg", {cv::IMWRITE_JPEG_QUALITY, quality});
}

std::string png(const cv::Mat& bgr) {
  return encoded(bgr, ".png", {});
}

}  // namespace apvi::viewer
