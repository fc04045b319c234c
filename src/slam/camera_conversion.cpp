// SPDX-License-Identifier: BSD-3-Clause
#include "slam/camera_conversion.hpp"

#include <torch/torch.h>

#include <Eigen/QR>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "apvi/core/error.hpp"
#include "apvi/sensors/lens.hpp"

namespace apvi::slam {
namespace {

using torch::Tensor;

constexpr double kHalfPixel = 0.5;  // offset between the pixel conventions
constexpr int kMaxFocalSteps = 60;
constexpr double kFocalStep = 1.02;

// Remap tables from pinhole pixels to camera pixels; false when one lies outside the image.
bool fill_maps(const CameraModel& camera, const CameraModel::Parameters& pinhole, cv::Mat& map_x,
               cv::Mat& map_y) {
  map_x.create(pinhole.height, pinhole.width, CV_32F);
  map_y.create(pinhole.height, pinhole.width, CV_32F);
  const double right = camera.parameters().width - kHalfPixel;
  const double bottom = camera.parameters().height - kHalfPixel;
  for (int v = 0; v < pinhole.height; ++v) {
    for (int u = 0; u < pinhole.width; ++u) {
      const Eigen::Vector3d ray((u - pinhole.cx) / pinhole.fx, (v - pinhole.cy) / pinhole.fy, 1.0);
      const auto pixel = camera.project(ray);
      if (!pixel || pixel->x() < -kHalfPixel || pixel->y() < -kHalfPixel || pixel->x() > right ||
          pixel->y() > bottom) {
        return false;
      }
      map_x.at<float>(v, u) = static_cast<float>(pixel->x());
      map_y.at<float>(v, u) = static_cast<float>(pixel->y());
    }
  }
  return true;
}

// Coefficients of gaussians::Intrinsics::lens_spread, by least squares over the image.
std::array<double, 3> lens_spread(const CameraModel& camera,
                                  const CameraModel::Parameters& pinhole) {
  constexpr int kRings = 24;
  constexpr int kDirections = 16;
  const CameraModel::Parameters& lens = camera.parameters();
  const Eigen::Vector2d focal = focal_lengths(lens);
  const double corner =
      std::hypot(0.5 * pinhole.width / pinhole.fx, 0.5 * pinhole.height / pinhole.fy);
  Eigen::MatrixX3d powers(kRings * kDirections, 3);
  Eigen::VectorXd spread(kRings * kDirections);
  Eigen::Index count = 0;
  for (int i = 0; i < kRings * kDirections; ++i) {
    const double radius = corner * (1 + i / kDirections) / kRings;
    const double angle = 2.0 * std::numbers::pi * (i % kDirections) / kDirections;
    const auto pixel = camera.project({radius * std::cos(angle), radius * std::sin(angle), 1.0});
    if (!pixel) continue;  // outside the image the distortion polynomial may not be invertible
    const double x = (pixel->x() - lens.cx) / focal.x();
    const double y = (pixel->y() - lens.cy) / focal.y();
    const double t = radius * radius;
    powers.row(count) << t, t * t, t * t * t;
    spread[count++] = (x * x + y * y) / t - 1.0;
  }
  const Eigen::Vector3d found =
      powers.topRows(count).colPivHouseholderQr().solve(spread.head(count));
  return {found.x(), found.y(), found.z()};
}

}  // namespace

gaussians::Intrinsics to_intrinsics(const CameraModel::Parameters& camera) {
  return {.fx = camera.fx,
          .fy = camera.fy,
          .cx = camera.cx + kHalfPixel,
          .cy = camera.cy + kHalfPixel,
          .width = camera.width,
          .height = camera.height};
}

CameraModel::Parameters to_parameters(const gaussians::Intrinsics& intrinsics) {
  return {.fx = intrinsics.fx,
          .fy = intrinsics.fy,
          .cx = intrinsics.cx - kHalfPixel,
          .cy = intrinsics.cy - kHalfPixel,
          .distortion = Distortion::none,
          .coefficients = {},
          .width = intrinsics.width,
          .height = intrinsics.height};
}

std::vector<medium::Lamp> lamps_of(const Rig& rig) {
  if (rig.cameras.empty()) return {};
  double total = 0.0;
  for (const LampCalibration& lamp : rig.lamps) total += lamp.intensity;
  std::vector<medium::Lamp> lamps;
  for (const LampCalibration& lamp : rig.lamps) {
    const SE3 T_camera_lamp = rig.cameras.front().T_body_camera.inverse() * lamp.T_body_lamp;
    const Eigen::Vector3d& p = T_camera_lamp.translation;
    const Eigen::Vector3d axis = T_camera_lamp.rotation * Eigen::Vector3d::UnitZ();
    lamps.push_back({.position_m = {p.x(), p.y(), p.z()},
                     .axis = {axis.x(), axis.y(), axis.z()},
                     .half_beam_rad = lamp.half_beam_rad,
                     .share = lamp.intensity / total});
  }
  return lamps;
}

Tensor to_tensor(const SE3& pose) {
  const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> matrix = pose.matrix();
  return torch::from_blob(const_cast<double*>(matrix.data()), {4, 4}, torch::kFloat64).clone();
}

SE3 to_se3(const Tensor& matrix) {
  const Tensor m = matrix.detach().to(torch::kCPU, torch::kFloat64).contiguous();
  const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> map(m.data_ptr<double>());
  const Eigen::Matrix3d R = map.topLeftCorner<3, 3>();
  return {Eigen::Quaterniond(R).normalized(), map.topRightCorner<3, 1>()};
}

Tensor to_tensor(const cv::Mat& image) {
  APVI_CHECK(image.depth() == CV_8U && (image.channels() == 1 || image.channels() == 3));
  cv::Mat rgb;
  cv::cvtColor(image, rgb, image.channels() == 1 ? cv::COLOR_GRAY2RGB : cv::COLOR_BGR2RGB);
  return torch::from_blob(rgb.data, {rgb.rows, rgb.cols, 3}, torch::kUInt8).clone();
}

Tensor scene_of(const cv::Mat& mask) {
  if (mask.empty()) return {};
  const cv::Mat whole = mask.clone();  // in one piece
  return torch::from_blob(whole.data, {whole.rows, whole.cols}, torch::kUInt8) > 0;
}

cv::Mat mask_of(const Tensor& scene) {
  if (!scene.defined()) return {};
  const Tensor bytes = scene.to(torch::kCPU, torch::kUInt8).contiguous() * 255;
  return cv::Mat(static_cast<int>(bytes.size(0)), static_cast<int>(bytes.size(1)), CV_8U,
                 bytes.data_ptr())
      .clone();
}

cv::Mat to_image(const Tensor& image) {
  Tensor bytes = image.detach().to(torch::kCPU);
  if (bytes.scalar_type() != torch::kUInt8) {
    bytes = (bytes.clamp(0.0, 1.0) * 255.0 + 0.5).to(torch::kUInt8);
  }
  bytes = bytes.contiguous();
  const cv::Mat rgb(static_cast<int>(bytes.size(0)), static_cast<int>(bytes.size(1)), CV_8UC3,
                    bytes.data_ptr());
  cv::Mat bgr;
  cv::cvtColor(rgb, bgr, cv::COLOR_RGB2BGR);
  return bgr;
}

Undistorter::Undistorter(const CameraModel& camera, double scale) {
  CameraModel::Parameters pinhole = camera.parameters();
  source_ = {pinhole.width, pinhole.height};
  pinhole.fx = focal_lengths(camera.parameters()).x();
  pinhole.fy = focal_lengths(camera.parameters()).y();
  if (pinhole.distortion != Distortion::none) {
    int tries = 0;
    while (!fill_maps(camera, pinhole, map_x_, map_y_)) {
      if (++tries > kMaxFocalSteps) {
        fail_input(
            "rig: cam0.coefficients: no pinhole image fits inside this lens's image; check them");
      }
      pinhole.fx *= kFocalStep;
      pinhole.fy *= kFocalStep;
    }
  }
  const gaussians::Intrinsics full = to_intrinsics(pinhole);
  const int width = static_cast<int>(std::lround(scale * full.width));
  const int height = static_cast<int>(std::lround(scale * full.height));
  if (width < 1 || height < 1)
    fail_input("mapping.image_scale: {} leaves less than one pixel", scale);
  const double sx = static_cast<double>(width) / full.width;
  const double sy = static_cast<double>(height) / full.height;
  intrinsics_ = {.fx = sx * full.fx,
                 .fy = sy * full.fy,
                 .cx = sx * full.cx,
                 .cy = sy * full.cy,
                 .width = width,
                 .height = height};
  if (!map_x_.empty()) intrinsics_.lens_spread = lens_spread(camera, pinhole);
}

cv::Mat Undistorter::operator()(const cv::Mat& image) const {
  return apply(image, cv::INTER_LINEAR, cv::INTER_AREA);
}

cv::Mat Undistorter::nearest(const cv::Mat& image) const {
  return apply(image, cv::INTER_NEAREST, cv::INTER_NEAREST);
}

cv::Mat Undistorter::mask(const cv::Mat& mask) const {
  if (mask.empty()) return {};
  return (*this)(mask) == 255;
}

cv::Mat Undistorter::apply(const cv::Mat& image, int remap_by, int resize_by) const {
  if (image.size() != source_) {
    fail_run("an image is {} x {}, but the rig says {} x {}", image.cols, image.rows, source_.width,
             source_.height);
  }
  cv::Mat pinhole;  // a new buffer: OpenCV must not write into the caller's image
  if (map_x_.empty()) {
    pinhole = image;
  } else {
    cv::remap(image, pinhole, map_x_, map_y_, remap_by, cv::BORDER_REPLICATE);
  }
  if (pinhole.cols == intrinsics_.width && pinhole.rows == intrinsics_.height)
    return pinhole.clone();
  cv::Mat reduced;
  cv::resize(pinhole, reduced, {intrinsics_.width, intrinsics_.height}, 0, 0, resize_by);
  return reduced;
}

}  // namespace apvi::slam
