// SPDX-License-Identifier: BSD-3-Clause
#include "vio/frontend/epipolar_check.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>

#include "apvi/geometry/so3.hpp"
#include "core/random.hpp"

namespace apvi::vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Pairs = std::vector<PointPair>;
using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;

constexpr std::size_t kMinPairs = 8;  // five pairs fit any motion
constexpr int kMinDirectionSamples = 10;
constexpr int kMaxDirectionSamples = 200;

// Sum of squared epipolar distances, truncated at the threshold.
double truncated_cost(const Matrix3d& essential, const Pairs& pairs, double threshold) {
  double cost = 0.0;
  for (const PointPair& pair : pairs) {
    const double d = epipolar_distance(essential, pair);
    cost += std::min(d * d, threshold * threshold);
  }
  return cost;
}

// A pair after removing a known rotation: the rotated point, and the normal of the plane that must
// contain the translation.
struct TurnedPair {
  Vector3d turned;
  Vector3d normal;
};

// As `truncated_cost`, but with the distance in the second frame only, which needs no square root.
double turned_cost(const Vector3d& direction, const std::vector<TurnedPair>& pairs,
                   double threshold, double enough) {
  const double most = threshold * threshold;
  double cost = 0.0;
  for (const TurnedPair& pair : pairs) {
    const double residual = direction.dot(pair.normal);
    const double line2 = direction.cross(pair.turned).head<2>().squaredNorm();
    cost += residual * residual < most * line2 ? residual * residual / line2 : most;
    if (cost > enough) break;
  }
  return cost;
}

// Number of samples to draw an outlier-free pair of correspondences with 99.9 % probability, given
// the truncated `cost` of the best model.
int samples_needed(double cost, std::size_t pairs, double threshold) {
  const double outliers = cost / (threshold * threshold * static_cast<double>(pairs));
  const double both_good = (1.0 - outliers) * (1.0 - outliers);
  if (both_good > 0.999) return 1;
  if (both_good < 1e-3) return kMaxDirectionSamples;
  return std::min(kMaxDirectionSamples,
                  static_cast<int>(std::log(1e-3) / std::log(1.0 - both_good)) + 1);
}

// With a known rotation every pair confines the translation to a plane; two pairs give its
// direction.
CameraMotion best_direction(const Pairs& pairs, const Quaterniond& R_now_before, double threshold) {
  const Matrix3d R = R_now_before.toRotationMatrix();
  std::vector<TurnedPair> turned;
  turned.reserve(pairs.size());
  for (const PointPair& pair : pairs) {
    const Vector3d g = R * pair.before.homogeneous();
    turned.push_back({g, g.cross(pair.now.homogeneous())});
  }
  Random random(1);
  CameraMotion best{R_now_before, Vector3d::UnitZ()};
  double best_cost = std::numeric_limits<double>::infinity();
  int needed = kMaxDirectionSamples;
  for (int k = 0; k < needed; ++k) {
    const auto& one = turned[static_cast<std::size_t>(random.next() % turned.size())];
    const auto& other = turned[static_cast<std::size_t>(random.next() % turned.size())];
    const Vector3d direction = one.normal.cross(other.normal);
    if (direction.norm() < 1e-14) continue;
    const double cost = turned_cost(direction.normalized(), turned, threshold, best_cost);
    if (cost >= best_cost) continue;
    best_cost = cost;
    best.direction = direction.normalized();
    needed = std::max(kMinDirectionSamples, samples_needed(cost, turned.size(), threshold));
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

// Adds a pair to the normal equations of a small rotation and a change of direction, with a Cauchy
// weight at half the threshold.
void add_pair(const CameraMotion& motion, const Matrix3d& R, const Matrix3d& essential,
              const Eigen::Matrix<double, 3, 2>& basis, const PointPair& pair, double threshold,
              Matrix5d& H, Vector5d& b) {
  const Vector3d before = pair.before.homogeneous();
  const Vector3d now = pair.now.homogeneous();
  const Vector3d line_now = essential * before;
  const double scale2 =
      line_now.head<2>().squaredNorm() + (essential.transpose() * now).head<2>().squaredNorm();
  if (scale2 < 1e-24) return;
  const Vector3d g = R * before;
  const double residual = now.dot(line_now);
  const double weight = 1.0 / (threshold * threshold * scale2 + 4.0 * residual * residual);
  Vector5d J;
  J.head<3>() = motion.direction.dot(g) * now - g.dot(now) * motion.direction;
  J.tail<2>() = basis.transpose() * g.cross(now);
  H.noalias() += (weight * J) * J.transpose();
  b -= (weight * residual) * J;
}

// Gauss-Newton on rotation and direction. The prior keeps the rotation near that of the gyro where
// it cannot be separated from the translation.
CameraMotion refined(CameraMotion motion, const Pairs& pairs, double threshold) {
  constexpr int kIterations = 4;
  constexpr double kRotationSigma = 0.01;  // [rad]
  constexpr double kRotationWeight = 1.0 / (kRotationSigma * kRotationSigma);
  Vector3d turn = Vector3d::Zero();
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const Matrix3d essential = motion.essential();
    const Matrix3d R = motion.R_now_before.toRotationMatrix();
    const auto basis = tangent_basis(motion.direction);
    Matrix5d H = 1e-6 * Matrix5d::Identity() / (threshold * threshold);
    Vector5d b = Vector5d::Zero();
    H.topLeftCorner<3, 3>() += kRotationWeight * Matrix3d::Identity();
    b.head<3>() -= kRotationWeight * turn;
    for (const PointPair& pair : pairs) {
      add_pair(motion, R, essential, basis, pair, threshold, H, b);
    }
    const Vector5d step = H.ldlt().solve(b);
    if (!step.allFinite()) break;
    turn += step.head<3>();
    motion.R_now_before = (so3::exp(step.head<3>()) * motion.R_now_before).normalized();
    motion.direction = (motion.direction + basis * step.tail<2>()).normalized();
  }
  return motion;
}

// The smaller of the two rotations of an essential matrix; the other one is rotated about the
// translation by another 180 degrees.
CameraMotion motion_of(const cv::Mat& essential) {
  cv::Mat rotations[2];
  cv::Mat direction;
  cv::decomposeEssentialMat(essential, rotations[0], rotations[1], direction);
  const bool first = cv::trace(rotations[0])[0] >= cv::trace(rotations[1])[0];
  using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  const Matrix3d R = Eigen::Map<const RowMajor>(rotations[first ? 0 : 1].ptr<double>());
  return {Quaterniond(R), Vector3d(direction.ptr<double>()).normalized()};
}

std::optional<CameraMotion> five_point(const Pairs& pairs, double threshold) {
  std::vector<cv::Point2d> before;
  std::vector<cv::Point2d> now;
  for (const PointPair& pair : pairs) {
    before.emplace_back(pair.before.x(), pair.before.y());
    now.emplace_back(pair.now.x(), pair.now.y());
  }
  constexpr double kConfidence = 0.99;
  constexpr int kMaxSamples = 200;
  // OpenCV uses a fixed seed here.
  const cv::Mat found = cv::findEssentialMat(before, now, cv::Mat::eye(3, 3, CV_64F), cv::RANSAC,
                                             kConfidence, threshold, kMaxSamples);
  if (found.rows != 3 || found.cols != 3) return std::nullopt;
  return motion_of(found);
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

std::optional<CameraMotion> best_motion(const Pairs& pairs,
                                        const std::optional<Quaterniond>& R_now_before,
                                        double threshold) {
  if (pairs.size() < kMinPairs) return std::nullopt;
  const std::optional<CameraMotion> coarse =
      R_now_before ? best_direction(pairs, *R_now_before, 3.0 * threshold)
                   : five_point(pairs, threshold);
  if (!coarse) return std::nullopt;
  const CameraMotion fine = refined(*coarse, pairs, threshold);
  const bool better = truncated_cost(fine.essential(), pairs, threshold) <=
                      truncated_cost(coarse->essential(), pairs, threshold);
  return better ? fine : coarse;
}

}  // namespace apvi::vio
