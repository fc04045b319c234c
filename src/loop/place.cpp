// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/loop/place.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

namespace apvi::loop {
namespace {

constexpr double kContrast = 0.01;  // of a SIFT feature: the usual 0.04 finds little in haze
constexpr double kClip = 3.0;       // of the contrast's amplification
const cv::Size kTiles(8, 8);
constexpr float kRatio = 0.8F;           // Lowe's test
constexpr double kSigmas = 3.0;          // of a ray that fits
constexpr double kLeastParallax = 0.02;  // [rad] between two rays whose meeting tells a distance
constexpr int kRounds = 200;
constexpr double kConfidence = 0.999;
constexpr double kLeastShare = 0.4;  // of the matches: else it is something alike

using Descriptors = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Descriptors numbers(const cv::Mat& descriptors) {
  using Bytes = Eigen::Matrix<unsigned char, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return Eigen::Map<const Bytes>(descriptors.ptr<unsigned char>(), descriptors.rows,
                                 descriptors.cols)
      .cast<float>();
}

/// The smallest of a row or column, if it is much smaller than the next; else -1.
template <typename Distances>
Eigen::Index standing_out(const Distances& squared) {
  Eigen::Index least = 0;
  const float smallest = squared.minCoeff(&least);
  float second = std::numeric_limits<float>::infinity();
  for (Eigen::Index k = 0; k < squared.size(); ++k) {
    if (k != least) second = std::min(second, squared[k]);
  }
  return smallest < kRatio * kRatio * second ? least : -1;
}

// Where two rays come closest to each other, as the first camera has it (Hartley and Sturm,
// Triangulation, 1997, section 4.1: the midpoint, which is as good as any where rays nearly meet).
std::optional<Eigen::Vector3d> meeting(const Eigen::Vector2d& ray, const Eigen::Vector2d& other,
                                       const SE3& T_other_first, double tolerance) {
  const SE3 T_first_other = T_other_first.inverse();
  const Eigen::Vector3d d1 = ray.homogeneous().normalized();
  const Eigen::Vector3d d2 = T_first_other.rotation * other.homogeneous().normalized();
  const Eigen::Vector3d between = T_first_other.translation;
  const double cosine = d1.dot(d2);
  const double square = 1.0 - cosine * cosine;
  if (square < kLeastParallax * kLeastParallax) return std::nullopt;
  const double s1 = (between.dot(d1) - cosine * between.dot(d2)) / square;
  const double s2 = (cosine * between.dot(d1) - between.dot(d2)) / square;
  if (s1 <= 0.0 || s2 <= 0.0) return std::nullopt;
  const Eigen::Vector3d point = 0.5 * (s1 * d1 + between + s2 * d2);
  const Eigen::Vector3d there = T_other_first * point;
  if (point.z() <= 0.0 || there.z() <= 0.0) return std::nullopt;
  const bool fits = (point.hnormalized() - ray).norm() < tolerance &&
                    (there.hnormalized() - other).norm() < tolerance;
  return fits ? std::optional(point) : std::nullopt;
}

SE3 to_pose(const cv::Mat& rotation_vector, const cv::Mat& translation) {
  cv::Mat rotation;
  cv::Rodrigues(rotation_vector, rotation);
  Eigen::Matrix3d R;
  Eigen::Vector3d t;
  cv::cv2eigen(rotation, R);
  cv::cv2eigen(translation, t);
  return {Eigen::Quaterniond(R).normalized(), t};
}

}  // namespace

std::size_t Place::depths() const {
  return static_cast<std::size_t>(
      std::count_if(points.begin(), points.end(), [](const auto& p) { return p.has_value(); }));
}

Place describe(const cv::Mat& grey, const Pinhole& camera, int most) {
  cv::Mat even;
  cv::createCLAHE(kClip, kTiles)->apply(grey, even);
  std::vector<cv::KeyPoint> found;
  cv::Mat descriptors;
  cv::SIFT::create(most, 3, kContrast)->detectAndCompute(even, cv::noArray(), found, descriptors);
  Place place;
  for (const cv::KeyPoint& point : found) {
    place.rays.emplace_back((point.pt.x + 0.5 - camera.cx) / camera.fx,
                            (point.pt.y + 0.5 - camera.cy) / camera.fy);
  }
  descriptors.convertTo(place.descriptors, CV_8U);
  place.points.resize(place.rays.size());
  return place;
}

// The whole table as a product of matrices: exact, as descriptors are whole numbers.
std::vector<std::pair<int, int>> match(const Place& a, const Place& b) {
  std::vector<std::pair<int, int>> pairs;
  if (a.descriptors.rows < 2 || b.descriptors.rows < 2) return pairs;
  const Descriptors da = numbers(a.descriptors);
  const Descriptors db = numbers(b.descriptors);
  Eigen::MatrixXf squared = -2.0F * da * db.transpose();
  squared.colwise() += da.rowwise().squaredNorm();
  squared.rowwise() += db.rowwise().squaredNorm().transpose();
  for (Eigen::Index j = 0; j < squared.cols(); ++j) {
    const Eigen::Index i = standing_out(squared.col(j));
    if (i >= 0 && standing_out(squared.row(i)) == j) {
      pairs.emplace_back(static_cast<int>(i), static_cast<int>(j));
    }
  }
  return pairs;
}

void give_depth(Place& place, const Place& other, const SE3& T_other_place, double sigma) {
  for (const auto& [i, j] : match(place, other)) {
    auto& point = place.points[static_cast<std::size_t>(i)];
    if (point) continue;
    point = meeting(place.rays[static_cast<std::size_t>(i)],
                    other.rays[static_cast<std::size_t>(j)], T_other_place, kSigmas * sigma);
  }
}

std::optional<Sighting> recognise(const Place& then, const Place& now, double sigma, int least) {
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> rays;
  for (const auto& [i, j] : match(then, now)) {
    const auto& point = then.points[static_cast<std::size_t>(i)];
    if (!point) continue;
    points.emplace_back(point->x(), point->y(), point->z());
    const Eigen::Vector2d& ray = now.rays[static_cast<std::size_t>(j)];
    rays.emplace_back(ray.x(), ray.y());
  }
  const int count = static_cast<int>(points.size());
  if (count < least) return std::nullopt;
  const cv::Mat K = cv::Mat::eye(3, 3, CV_64F);
  cv::Mat rotation;
  cv::Mat translation;
  std::vector<int> inliers;
  const bool found = cv::solvePnPRansac(points, rays, K, cv::noArray(), rotation, translation,
                                        false, kRounds, static_cast<float>(kSigmas * sigma),
                                        kConfidence, inliers, cv::SOLVEPNP_EPNP);
  const int agree = static_cast<int>(inliers.size());
  if (!found || agree < least || agree < kLeastShare * count) return std::nullopt;
  std::vector<cv::Point3d> good_points;
  std::vector<cv::Point2d> good_rays;
  for (const int k : inliers) {
    good_points.push_back(points[static_cast<std::size_t>(k)]);
    good_rays.push_back(rays[static_cast<std::size_t>(k)]);
  }
  cv::solvePnPRefineLM(good_points, good_rays, K, cv::noArray(), rotation, translation);
  return Sighting{to_pose(rotation, translation), agree, count};
}

}  // namespace apvi::loop
