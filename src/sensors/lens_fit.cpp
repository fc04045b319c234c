// SPDX-License-Identifier: BSD-3-Clause
#include "sensors/lens_fit.hpp"

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "sensors/lens_equations.hpp"

namespace apvi {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr Eigen::Index kIntrinsics = 4;

// Which of intrinsics and coefficients are estimated. Radtan without k3 and k6: with them,
// numerator and denominator get roots that cancel but for a spike between the samples.
const std::vector<Eigen::Index>& unknowns(Distortion distortion) {
  static const std::vector<Eigen::Index> rational = {0, 1, 2, 3, 4, 5, 6, 7, 9, 10};
  static const std::vector<Eigen::Index> equidistant = {0, 1, 2, 3, 4, 5, 6, 7};
  return distortion == Distortion::radtan ? rational : equidistant;
}

lens::Coefficients coefficients(const VectorXd& x) {
  lens::Coefficients k{};
  std::copy(x.data() + kIntrinsics, x.data() + x.size(), k.begin());
  return k;
}

// A pixel of the central model with intrinsics and coefficients `x`, of a direction.
Vector2d predict(Distortion distortion, const VectorXd& x, const Vector3d& direction) {
  const lens::Coefficients k = coefficients(x);
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

double radius_of(Distortion distortion, const Vector3d& direction) {
  return distortion == Distortion::radtan ? direction.hnormalized().norm()
                                          : std::atan2(direction.head<2>().norm(), direction.z());
}

class LensFit {
 public:
  LensFit(Distortion distortion, const std::vector<LensSample>& samples)
      : distortion_(distortion), free_(unknowns(distortion)), samples_(samples) {
    for (const LensSample& sample : samples) {
      max_radius_ = std::max(max_radius_, radius_of(distortion, sample.direction));
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
      if (!(gain > 0.0) || folds(next)) {
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
  // Whether the lens maps wider rays back into the image.
  bool folds(const VectorXd& x) const {
    constexpr int kSteps = 200;
    constexpr double kMargin = 1.05;
    const lens::Coefficients k = coefficients(x);
    for (int i = 1; i <= kSteps; ++i) {
      const double radius = kMargin * max_radius_ * i / kSteps;
      double slope = 0.0;
      distortion_ == Distortion::radtan ? lens::radtan_radius(radius, k, slope)
                                        : lens::equidistant_radius(radius, k, slope);
      if (!(slope > 0.0)) return true;
    }
    return false;
  }

  VectorXd residual(const VectorXd& x) const {
    VectorXd r(2 * static_cast<Eigen::Index>(samples_.size()));
    for (std::size_t i = 0; i < samples_.size(); ++i) {
      r.segment<2>(2 * static_cast<Eigen::Index>(i)) =
          predict(distortion_, x, samples_[i].direction) - samples_[i].pixel;
    }
    return r;
  }

  Eigen::MatrixXd jacobian(const VectorXd& x) const {
    Eigen::MatrixXd J(2 * static_cast<Eigen::Index>(samples_.size()),
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
  const std::vector<LensSample>& samples_;
  double max_radius_ = 0.0;  // on the plane z = 1 (radtan), or angle (equidistant)
};

// nullopt for a fit that went astray.
std::optional<CameraModel> to_model(CameraModel::Parameters p, const VectorXd& x) {
  if (!x.allFinite() || x(0) <= 0.0 || x(1) <= 0.0) return std::nullopt;
  p.fx = x(0);
  p.fy = x(1);
  p.cx = x(2);
  p.cy = x(3);
  p.coefficients = coefficients(x);
  return CameraModel(p);
}

}  // namespace

std::optional<CameraModel> fit_lens(const CameraModel::Parameters& start,
                                    const std::vector<LensSample>& samples) {
  const Eigen::Index count = start.distortion == Distortion::radtan ? 8 : 4;
  VectorXd x(kIntrinsics + count);
  x.head<kIntrinsics>() << start.fx, start.fy, start.cx, start.cy;
  x.tail(count) = Eigen::Map<const VectorXd>(start.coefficients.data(), count);
  return to_model(start, LensFit(start.distortion, samples).solve(x));
}

}  // namespace apvi
