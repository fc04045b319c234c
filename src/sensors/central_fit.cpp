// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/central_fit.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/sensors/lens.hpp"
#include "sensors/lens_equations.hpp"

namespace apvi {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int kFitColumns = 28;
constexpr int kErrorColumns = 41;
constexpr std::size_t kMinSamples = 100;  // for some ten unknowns
constexpr Eigen::Index kIntrinsics = 4;

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

// Which of intrinsics and coefficients are estimated. Radtan without k3 and k6: with them,
// numerator and denominator get roots that cancel but for a spike between the samples.
const std::vector<Eigen::Index>& unknowns(Distortion distortion) {
  static const std::vector<Eigen::Index> rational = {0, 1, 2, 3, 4, 5, 6, 7, 9, 10};
  static const std::vector<Eigen::Index> equidistant = {0, 1, 2, 3, 4, 5, 6, 7};
  return distortion == Distortion::radtan ? rational : equidistant;
}

// A pixel of the central model with intrinsics and coefficients `x`, of a direction.
Vector2d predict(Distortion distortion, const VectorXd& x, const Vector3d& direction) {
  lens::Coefficients k{};
  std::copy(x.data() + kIntrinsics, x.data() + x.size(), k.begin());
  Vector2d m;
  if (distortion == Distortion::radtan) {
    Eigen::Matrix2d jacobian;
    m = lens::distort_radtan(direction.hnormalized(), k, jacobian);
  } else {
    const double across = direction.head<2>().norm();
    double slope = 0.0;
    const double radius = lens::equidistant_radius(std::atan2(across, direction.z()), k, slope);
    m = across < 1e-12 ? Vector2d(Vector2d::Zero())
                       : Vector2d(radius / across * direction.head<2>());
  }
  return x.head<2>().cwiseProduct(m) + x.segment<2>(2);
}

class LensFit {
 public:
  LensFit(Distortion distortion, const std::vector<PixelRay>& samples, const Vector3d& center,
          double range)
      : distortion_(distortion), free_(unknowns(distortion)) {
    for (const auto& [pixel, ray] : samples) {
      pixels_.push_back(pixel);
      directions_.push_back(ray.at(range, center) - center);
    }
  }

  // Levenberg-Marquardt; the damping is relative to the columns of the Jacobian.
  VectorXd solve(VectorXd x) const {
    constexpr int kIterations = 100;
    double damping = 1e-3;
    VectorXd r = residual(x);
    for (int i = 0; i < kIterations && damping < 1e9; ++i) {
      const Eigen::MatrixXd J = jacobian(x);
      const VectorXd change = step(J, r, damping);
      VectorXd next = x;
      for (std::size_t k = 0; k < free_.size(); ++k) {
        next(free_[k]) += change(static_cast<Eigen::Index>(k));
      }
      const VectorXd r_next = residual(next);
      const double gain = r.squaredNorm() - r_next.squaredNorm();
      if (!(gain > 0.0)) {
        damping *= 8.0;
        continue;
      }
      const bool done = gain < 1e-6 * r.squaredNorm();
      x = next;
      r = r_next;
      damping = std::max(1e-12, damping / 8.0);
      if (done) break;
    }
    return x;
  }

 private:
  VectorXd residual(const VectorXd& x) const {
    VectorXd r(2 * static_cast<Eigen::Index>(pixels_.size()));
    for (std::size_t i = 0; i < pixels_.size(); ++i) {
      r.segment<2>(2 * static_cast<Eigen::Index>(i)) =
          predict(distortion_, x, directions_[i]) - pixels_[i];
    }
    return r;
  }

  Eigen::MatrixXd jacobian(const VectorXd& x) const {
    Eigen::MatrixXd J(2 * static_cast<Eigen::Index>(pixels_.size()),
                      static_cast<Eigen::Index>(free_.size()));
    for (Eigen::Index column = 0; column < J.cols(); ++column) {
      const Eigen::Index i = free_[static_cast<std::size_t>(column)];
      const double h = 1e-6 * std::max(1.0, std::abs(x(i)));
      VectorXd plus = x;
      VectorXd minus = x;
      plus(i) += h;
      minus(i) -= h;
      J.col(column) = (residual(plus) - residual(minus)) / (2.0 * h);
    }
    return J;
  }

  static VectorXd step(const Eigen::MatrixXd& J, const VectorXd& r, double damping) {
    const Eigen::Index n = J.cols();
    Eigen::MatrixXd damped(J.rows() + n, n);
    damped.topRows(J.rows()) = J;
    damped.bottomRows(n) = (std::sqrt(damping) * J.colwise().norm()).asDiagonal();
    VectorXd right = VectorXd::Zero(damped.rows());
    right.head(r.size()) = -r;
    return damped.colPivHouseholderQr().solve(right);
  }

  Distortion distortion_;
  std::vector<Eigen::Index> free_;
  std::vector<Vector2d> pixels_;
  std::vector<Vector3d> directions_;
};

// nullopt for a fit that went astray.
std::optional<CameraModel> to_model(const CameraModel& lens, Distortion distortion,
                                    const VectorXd& x) {
  if (!x.allFinite() || x(0) <= 0.0 || x(1) <= 0.0) return std::nullopt;
  CameraModel::Parameters p = lens.parameters();
  p.fx = x(0);
  p.fy = x(1);
  p.cx = x(2);
  p.cy = x(3);
  p.distortion = distortion;
  p.coefficients = {};
  std::copy(x.data() + kIntrinsics, x.data() + x.size(), p.coefficients.begin());
  return CameraModel(p);
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
std::optional<CameraModel> fit_lens(const PortCamera& camera, const std::vector<PixelRay>& samples,
                                    const Vector3d& center, double range, Distortion distortion) {
  const CameraModel::Parameters& p = camera.lens().parameters();
  const bool flat = camera.port().kind == PortKind::flat;
  const double enlarged = flat ? camera.port().water_index / camera.port().air_index : 1.0;
  const Eigen::Index coefficients = distortion == Distortion::radtan ? 8 : 4;
  VectorXd x = VectorXd::Zero(kIntrinsics + coefficients);
  x.head<4>() << enlarged * focal_lengths(p), p.cx, p.cy;
  if (distortion == Distortion::radtan) {
    const double bend = enlarged * enlarged - 1.0;
    x(kIntrinsics) = -0.25 * bend;
    x(kIntrinsics + 5) = -0.75 * bend;
  }
  const LensFit fit(distortion, samples, center, range);
  return to_model(camera.lens(), distortion, fit.solve(x));
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
    const auto model = fit_lens(camera, samples, center, range_m, candidate);
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
