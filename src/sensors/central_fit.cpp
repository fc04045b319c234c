// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/central_fit.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/sensors/lens.hpp"
#include "sensors/lens_fit.hpp"

namespace apvi {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kFitColumns = 28;
constexpr int kErrorColumns = 41;
constexpr std::size_t kMinSamples = 100;  // for some ten unknowns

struct PixelRay {
  Vector2d pixel;
  WaterRay ray;
};

// Pixels over the whole image, with its border.
std::vector<PixelRay> pixel_rays(const PortCamera& camera, int columns) {
  const CameraModel::Parameters& p = camera.lens().parameters();
  const int rows = std::max(2, static_cast<int>(std::lround(columns * p.height / p.width)));
  std::vector<PixelRay> samples;
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) {
      const Vector2d pixel(x * (p.width - 1.0) / (columns - 1), y * (p.height - 1.0) / (rows - 1));
      if (const auto ray = camera.ray(pixel)) samples.push_back({pixel, *ray});
    }
  }
  return samples;
}

// The point of least squared distance to all rays.
Vector3d nearest_point(const std::vector<PixelRay>& samples) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (const auto& [pixel, ray] : samples) {
    const Eigen::Matrix3d across =
        Eigen::Matrix3d::Identity() - ray.direction * ray.direction.transpose();
    sum += across;
    right += across * ray.origin;
  }
  return sum.ldlt().solve(right);
}

CentralError error_of(const std::vector<PixelRay>& samples, const CentralCamera& central,
                      double range) {
  CentralError error;
  double sum = 0.0;
  for (const auto& [pixel, ray] : samples) {
    const auto seen = central.model.project(ray.at(range, central.center) - central.center);
    const double distance = seen ? (*seen - pixel).norm() : std::numeric_limits<double>::infinity();
    sum += distance * distance;
    error.max_px = std::max(error.max_px, distance);
  }
  error.rms_px = std::sqrt(sum / static_cast<double>(samples.size()));
  return error;
}

// Start: close behind a flat port, tan(angle in air) = n m / sqrt(1 - (n^2 - 1) m^2) for m on the
// plane z = 1 in the water; its Pade approximant is a rational lens.
CameraModel::Parameters start_of(const PortCamera& camera, Distortion distortion) {
  const bool flat = camera.port().kind == PortKind::flat;
  const double enlarged = flat ? camera.port().water_index / camera.port().air_index : 1.0;
  CameraModel::Parameters start = camera.lens().parameters();
  const Vector2d focal = enlarged * focal_lengths(start);
  start.fx = focal.x();
  start.fy = focal.y();
  start.distortion = distortion;
  start.coefficients = {};
  if (distortion == Distortion::equidistant) return start;
  const double bend = enlarged * enlarged - 1.0;
  start.coefficients[0] = -0.25 * bend;
  start.coefficients[5] = -0.75 * bend;
  return start;
}

std::vector<LensSample> lens_samples(const std::vector<PixelRay>& rays, const Vector3d& center,
                                     double range) {
  std::vector<LensSample> samples;
  for (const auto& [pixel, ray] : rays) {
    samples.push_back({pixel, ray.at(range, center) - center});
  }
  return samples;
}

}  // namespace

CentralCamera fit_central_camera(const PortCamera& camera, double range_m,
                                 std::optional<Distortion> distortion) {
  const std::vector<PixelRay> samples = pixel_rays(camera, kFitColumns);
  if (samples.size() < kMinSamples) fail_input("hardly any pixel sees through the port");
  const Vector3d center = nearest_point(samples);
  std::optional<CentralCamera> best;
  double least = std::numeric_limits<double>::infinity();
  for (const Distortion candidate : {Distortion::radtan, Distortion::equidistant}) {
    if (distortion.value_or(candidate) != candidate) continue;
    const auto model =
        fit_lens(start_of(camera, candidate), lens_samples(samples, center, range_m));
    if (!model) continue;
    const double error = error_of(samples, {*model, center}, range_m).rms_px;
    if (!(error < least)) continue;
    least = error;
    best = {*model, center};
  }
  if (!best) fail_input("no central camera describes the whole image behind this port");
  return *best;
}

CentralError central_error(const PortCamera& camera, const CentralCamera& central, double range_m) {
  return error_of(pixel_rays(camera, kErrorColumns), central, range_m);
}

std::string port_summary(const CameraCalibration& camera) {
  if (!camera.port) return "";
  const PortCalibration& port = *camera.port;
  const CentralCamera central{camera.model, -port.p_camera_lens};
  std::string text = fmt::format(
      "behind a {} port; used as the nearest central camera, {} with a focal length of {:.1f} px. "
      "It is off by",
      port.camera.port().kind == PortKind::flat ? "flat" : "dome",
      lens_name(camera.model.parameters().distortion), camera.model.parameters().fx);
  const double range = port.working_range_m;
  for (const double at : {0.25 * range, range, 4.0 * range}) {
    const CentralError error = central_error(port.camera, central, at);
    text += fmt::format("{} {:.2f} px RMS, {:.2f} px at most at {:g} m", at < range ? "" : ",",
                        error.rms_px, error.max_px, at);
  }
  return text;
}

}  // namespace apvi
