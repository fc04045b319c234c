// SPDX-License-Identifier: BSD-3-Clause
#include "importer/assumed_camera.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "apvi/core/error.hpp"

namespace apvi::importer {
namespace {

constexpr int kFitSamples = 200;
constexpr double kMaxAngle = 1.5;  // [rad] in air; a flat port shows no more

double radius_over_f(Lens lens, double angle) {
  return lens == Lens::rectilinear ? std::tan(angle) : angle;
}

double angle_of(Lens lens, double radius_over_f) {
  return lens == Lens::rectilinear ? std::atan(radius_over_f) : radius_over_f;
}

// Focal length in the medium of the angle [px].
double focal_length(const FieldOfView& view, double half_px) {
  const double half = 0.5 * view.degrees * std::numbers::pi / 180.0;
  const double limit = view.lens == Lens::rectilinear ? 160.0 : 220.0;
  if (!(view.degrees > 1.0 && view.degrees < limit)) {
    fail_input("field of view: {} degrees; must be between 1 and {}", view.degrees, limit);
  }
  return half_px / radius_over_f(view.lens, half);
}

// Least squares for r = f (a + k1 a^3 + k2 a^5 + k3 a^7 + k4 a^9), with f fixed: the angles in the
// water of radii up to the corner.
CameraModel::Coefficients fit_under_water(Lens lens, double f_air, double f, double corner_px) {
  Eigen::Matrix<double, kFitSamples, 4> powers;
  Eigen::Matrix<double, kFitSamples, 1> rest;
  for (int i = 0; i < kFitSamples; ++i) {
    const double r = corner_px * (i + 1) / kFitSamples;
    const double in_air = std::min(kMaxAngle, angle_of(lens, r / f_air));
    const double a = std::asin(std::sin(in_air) / kWaterRefraction);
    for (int k = 0; k < 4; ++k) powers(i, k) = std::pow(a, 3 + 2 * k);
    rest(i) = r / f - a;
  }
  const Eigen::Vector4d k = powers.colPivHouseholderQr().solve(rest);
  return {k[0], k[1], k[2], k[3]};
}

}  // namespace

FieldOfView default_field_of_view() {
  return {.origin = "the default of 70 degrees"};
}

std::optional<FieldOfView> gopro_field_of_view(const std::string& device, const std::string& mode,
                                               std::optional<double> diagonal_deg) {
  const bool known = diagonal_deg && *diagonal_deg > 20.0 && *diagonal_deg < 200.0;
  const bool gopro = device.starts_with("HERO") || device.starts_with("Hero") || !mode.empty();
  if (!known && !gopro) return std::nullopt;
  const char letter = mode.empty() ? 'W' : mode.front();
  const bool linear = letter == 'L' || letter == 'N';
  FieldOfView view{.lens = linear ? Lens::rectilinear : Lens::equidistant, .in_air = true};
  view.diagonal = known;
  view.stated = known || !mode.empty();
  // GoPro's published angles of 16:9 video: wide, linear, narrow.
  const double nominal = letter == 'L' ? 87.0 : letter == 'N' ? 73.0 : 118.0;
  view.degrees = known ? *diagonal_deg : nominal;
  view.origin = known          ? "the camera's metadata (ZFOV)"
                : mode.empty() ? "GoPro's wide mode, since the file does not tell the mode"
                               : "the camera's mode " + mode;
  return view;
}

CameraModel::Parameters assumed_camera(const FieldOfView& view, ImageSize size, bool under_water) {
  CameraModel::Parameters p;
  p.width = size.width;
  p.height = size.height;
  p.cx = 0.5 * (size.width - 1);
  p.cy = 0.5 * (size.height - 1);
  const double corner_px = 0.5 * std::hypot(size.width, size.height);
  const double f = focal_length(view, view.diagonal ? corner_px : 0.5 * size.width);
  const bool port = view.in_air && under_water;
  p.fx = p.fy = port ? kWaterRefraction * f : f;
  if (port) {
    p.distortion = Distortion::equidistant;
    p.coefficients = fit_under_water(view.lens, f, p.fx, corner_px);
  } else if (view.lens == Lens::equidistant) {
    p.distortion = Distortion::equidistant;
  }
  return p;
}

}  // namespace apvi::importer
