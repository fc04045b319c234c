// SPDX-License-Identifier: BSD-3-Clause
#include "vio/visual/two_view.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>

#include "core/median.hpp"

namespace apvi::vio {
namespace {

using Eigen::Vector3d;
using Pairs = std::vector<PointPair>;

// A motion that supports fewer pairs than this share of the best one's is left out.
constexpr double kMinShare = 0.8;

// Length of the translation below which a homography is a pure rotation [distances to the plane].
constexpr double kMinTranslation = 0.005;

SE3 of_unit_length(SE3 T) {
  T.translation.normalize();
  return T;
}

std::optional<SE3> motion_of_essential_matrix(const Pairs& pairs, double max_error) {
  const auto motion = best_motion(pairs, std::nullopt, max_error);
  if (!motion) return std::nullopt;
  return of_unit_length(SE3{motion->R_now_before, motion->direction}.inverse());
}

std::vector<SE3> motions_of_homography(const Pairs& pairs, double max_error) {
  if (pairs.size() < 4) return {};
  std::vector<cv::Point2d> before;
  std::vector<cv::Point2d> now;
  for (const PointPair& pair : pairs) {
    before.emplace_back(pair.before.x(), pair.before.y());
    now.emplace_back(pair.now.x(), pair.now.y());
  }
  const cv::Mat H = cv::findHomography(before, now, cv::RANSAC, max_error);
  std::vector<SE3> motions;
  if (H.empty()) return motions;
  std::vector<cv::Mat> rotations, translations, normals;
  cv::decomposeHomographyMat(H, cv::Mat::eye(3, 3, CV_64F), rotations, translations, normals);
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    Eigen::Matrix3d R;
    Vector3d t;
    cv::cv2eigen(rotations[i], R);
    cv::cv2eigen(translations[i], t);
    if (!(t.norm() > kMinTranslation)) continue;
    motions.push_back(of_unit_length(SE3{Eigen::Quaterniond(R), t}.inverse()));
  }
  return motions;
}

// Pairs that lie on the epipolar lines and in front of both cameras.
std::size_t supporting_pairs(const Pairs& pairs, const SE3& T_first_second, double max_error) {
  const SE3 T = T_first_second.inverse();
  const Eigen::Matrix3d essential = essential_matrix(T.rotation, T.translation);
  return static_cast<std::size_t>(std::ranges::count_if(pairs, [&](const PointPair& pair) {
    return epipolar_distance(essential, pair) < max_error && triangulate(pair, T_first_second);
  }));
}

}  // namespace

// Minimizes |z1 d1 - (t + z2 d2)|² for the rays d1 and d2 in the first camera.
std::optional<TwoViewPoint> triangulate(const PointPair& pair, const SE3& T_first_second) {
  const Vector3d d1 = pair.before.homogeneous();
  const Vector3d d2 = T_first_second.rotation * pair.now.homogeneous();
  Eigen::Matrix<double, 3, 2> A;
  A << d1, -d2;
  const Eigen::Matrix2d normal = A.transpose() * A;
  const double parallax = std::atan2(d1.cross(d2).norm(), d1.dot(d2));
  if (!(normal.determinant() > 0.0)) return std::nullopt;
  const Eigen::Vector2d z = normal.inverse() * (A.transpose() * T_first_second.translation);
  if (!(z.x() > 0.0 && z.y() > 0.0)) return std::nullopt;
  return TwoViewPoint{z.x(), parallax};
}

std::vector<SE3> possible_motions(const Pairs& pairs, double max_error) {
  std::vector<SE3> motions = motions_of_homography(pairs, max_error);
  if (const auto motion = motion_of_essential_matrix(pairs, max_error)) motions.push_back(*motion);
  std::vector<std::size_t> support;
  for (const SE3& motion : motions) support.push_back(supporting_pairs(pairs, motion, max_error));
  std::vector<SE3> possible;
  if (support.empty()) return possible;
  const auto best = static_cast<double>(*std::ranges::max_element(support));
  for (std::size_t i = 0; i < motions.size(); ++i) {
    const auto count = static_cast<double>(support[i]);
    if (count > 0.0 && count >= kMinShare * best) possible.push_back(motions[i]);
  }
  return possible;
}

double median_parallax(const Pairs& pairs, const SE3& T_first_second) {
  std::vector<double> angles;
  for (const PointPair& pair : pairs) {
    if (const auto point = triangulate(pair, T_first_second)) angles.push_back(point->parallax);
  }
  return median(std::move(angles));
}

}  // namespace apvi::vio
