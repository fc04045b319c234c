// SPDX-License-Identifier: BSD-3-Clause
#include "vio/epipolar_check.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>

#include "apvi/core/random.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi::vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Pairs = std::vector<PointPair>;
using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;

constexpr std::size_t kFewestPairs = 8;  // five fit any motion; so few more prove little

struct Motion {
  Quaterniond R_now_before = Quaterniond::Identity();
  Vector3d direction = Vector3d::UnitZ();  // of the translation, unit
};

Matrix3d essential_of(const Motion& motion) {
  return essential_matrix(motion.R_now_before, motion.direction);
}

// Sum of squared distances, each no more than the threshold's.
double truncated_cost(const Matrix3d& essential, const Pairs& pairs, double threshold) {
  double cost = 0.0;
  for (const PointPair& pair : pairs) {
    const double d = epipolar_distance(essential, pair);
    cost += std::min(d * d, threshold * threshold);
  }
  return cost;
}

// With a known rotation every pair confines the translation to a plane; two give its direction.
Motion best_direction(const Pairs& pairs, const Quaterniond& R_now_before, double threshold) {
  constexpr int kSamples = 60;
  std::vector<Vector3d> normals;
  for (const PointPair& pair : pairs) {
    normals.push_back((R_now_before * pair.before.homogeneous()).cross(pair.now.homogeneous()));
  }
  Random random(1);
  Motion best{R_now_before, Vector3d::UnitZ()};
  double best_cost = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kSamples; ++k) {
    const auto i = static_cast<std::size_t>(random.next() % normals.size());
    const auto j = static_cast<std::size_t>(random.next() % normals.size());
    const Vector3d direction = normals[i].cross(normals[j]);
    if (direction.norm() < 1e-14) continue;
    const Motion motion{R_now_before, direction.normalized()};
    const double cost = truncated_cost(essential_of(motion), pairs, threshold);
    if (cost < best_cost) {
      best_cost = cost;
      best = motion;
    }
  }
  return best;
}

Eigen::Matrix<double, 3, 2> tangent_basis(const Vector3d& unit) {
  const Vector3d axis = std::abs(unit.z()) < 0.9 ? Vector3d::UnitZ() : Vector3d::UnitX();
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = unit.cross(axis).normalized();
  basis.col(1) = unit.cross(basis.col(0));
  return basis;
}

// Gauss-Newton on rotation and direction, Cauchy weights. The prior keeps the rotation near the
// gyro's where the pairs cannot tell it from the translation.
Motion refined(Motion motion, const Pairs& pairs, double threshold) {
  constexpr int kIterations = 4;
  constexpr double kRotationSigma = 0.01;  // [rad]
  Vector3d turned = Vector3d::Zero();
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const Matrix3d essential = essential_of(motion);
    const auto basis = tangent_basis(motion.direction);
    Matrix5d H = 1e-6 * Matrix5d::Identity() / (threshold * threshold);
    Vector5d b = Vector5d::Zero();
    H.topLeftCorner<3, 3>() += Matrix3d::Identity() / (kRotationSigma * kRotationSigma);
    b.head<3>() -= turned / (kRotationSigma * kRotationSigma);
    for (const PointPair& pair : pairs) {
      const Vector3d before = pair.before.homogeneous();
      const Vector3d now = pair.now.homogeneous();
      const Vector3d g = motion.R_now_before * before;
      const double scale = std::hypot((essential * before).head<2>().norm(),
                                      (essential.transpose() * now).head<2>().norm());
      if (scale < 1e-12) continue;
      const double residual = now.dot(essential * before) / scale;
      const double weight =
          1.0 / (threshold * threshold + 4.0 * residual * residual);  // Cauchy, half a threshold
      Vector5d J;
      J.head<3>() = (motion.direction.dot(g) * now - g.dot(now) * motion.direction) / scale;
      J.tail<2>() = basis.transpose() * g.cross(now) / scale;
      H += weight * J * J.transpose();
      b -= weight * J * residual;
    }
    const Vector5d step = H.ldlt().solve(b);
    if (!step.allFinite()) break;
    turned += step.head<3>();
    motion.R_now_before = (so3::exp(step.head<3>()) * motion.R_now_before).normalized();
    motion.direction = (motion.direction + basis * step.tail<2>()).normalized();
  }
  return motion;
}

Matrix3d with_rotation(const Pairs& pairs, const Quaterniond& R_now_before, double threshold) {
  const Motion coarse = best_direction(pairs, R_now_before, 3.0 * threshold);
  const Motion fine = refined(coarse, pairs, threshold);
  const Matrix3d a = essential_of(coarse);
  const Matrix3d b = essential_of(fine);
  return truncated_cost(b, pairs, threshold) <= truncated_cost(a, pairs, threshold) ? b : a;
}

std::optional<Matrix3d> without_rotation(const Pairs& pairs, double threshold) {
  std::vector<cv::Point2d> before;
  std::vector<cv::Point2d> now;
  for (const PointPair& pair : pairs) {
    before.emplace_back(pair.before.x(), pair.before.y());
    now.emplace_back(pair.now.x(), pair.now.y());
  }
  constexpr double kConfidence = 0.99;
  constexpr int kMaxSamples = 200;
  // OpenCV seeds this search itself, the same way each time.
  const cv::Mat found = cv::findEssentialMat(before, now, cv::Mat::eye(3, 3, CV_64F), cv::RANSAC,
                                             kConfidence, threshold, kMaxSamples);
  if (found.rows != 3 || found.cols != 3) return std::nullopt;
  return Matrix3d(
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(found.ptr<double>()));
}

}  // namespace

double epipolar_distance(const Matrix3d& essential, const PointPair& pair) {
  const Vector3d line_now = essential * pair.before.homogeneous();
  const Vector3d line_before = essential.transpose() * pair.now.homogeneous();
  const double scale2 = line_now.head<2>().squaredNorm() + line_before.head<2>().squaredNorm();
  if (scale2 < 1e-24) return 0.0;
  return std::abs(pair.now.homogeneous().dot(line_now)) / std::sqrt(scale2);
}

Matrix3d essential_matrix(const Quaterniond& R_now_before, const Vector3d& t_now_before) {
  return so3::hat(t_now_before) * R_now_before.toRotationMatrix();
}

std::optional<Matrix3d> best_essential(const Pairs& pairs,
                                       const std::optional<Quaterniond>& R_now_before,
                                       double threshold) {
  if (pairs.size() < kFewestPairs) return std::nullopt;
  if (!R_now_before) return without_rotation(pairs, threshold);
  return with_rotation(pairs, *R_now_before, threshold);
}

}  // namespace apvi::vio
