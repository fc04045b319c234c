// SPDX-License-Identifier: BSD-3-Clause
#include "vio/visual/resection.hpp"

#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <vector>

#include "apvi/geometry/so3.hpp"

namespace apvi::vio {
namespace {

constexpr int kIterations = 100;
constexpr double kConfidence = 0.999;
constexpr double kMinInliers = 0.5;  // share of the observed points

struct KnownPoints {
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> seen;
};

KnownPoints known_points(const TrackedFrame& frame, const PointsById& points) {
  KnownPoints found;
  for (const FeatureObservation& seen : frame.observations) {
    const auto point = points.find(seen.id);
    if (seen.camera != 0 || point == points.end()) continue;
    found.points.emplace_back(point->second.x(), point->second.y(), point->second.z());
    found.seen.emplace_back(seen.point.x(), seen.point.y());
  }
  return found;
}

KnownPoints selected(const KnownPoints& all, const std::vector<int>& indices) {
  KnownPoints some;
  for (const int i : indices) {
    some.points.push_back(all.points[static_cast<std::size_t>(i)]);
    some.seen.push_back(all.seen[static_cast<std::size_t>(i)]);
  }
  return some;
}

}  // namespace

std::optional<SE3> resect(const TrackedFrame& frame, const PointsById& points, double max_error,
                          std::size_t min_points) {
  const KnownPoints all = known_points(frame, points);
  if (all.points.size() < std::max<std::size_t>(min_points, 4)) return std::nullopt;
  const cv::Mat K = cv::Mat::eye(3, 3, CV_64F);
  cv::Mat rotation, translation;
  std::vector<int> inliers;
  const bool found = cv::solvePnPRansac(
      all.points, all.seen, K, cv::noArray(), rotation, translation, false, kIterations,
      static_cast<float>(max_error), kConfidence, inliers, cv::SOLVEPNP_AP3P);
  const auto count = static_cast<double>(inliers.size());
  if (!found || inliers.size() < min_points ||
      count < kMinInliers * static_cast<double>(all.points.size())) {
    return std::nullopt;
  }
  const KnownPoints good = selected(all, inliers);
  cv::solvePnPRefineLM(good.points, good.seen, K, cv::noArray(), rotation, translation);
  Eigen::Vector3d turn;
  Eigen::Vector3d t;
  cv::cv2eigen(rotation, turn);
  cv::cv2eigen(translation, t);
  if (!turn.allFinite() || !t.allFinite()) return std::nullopt;
  return SE3{so3::exp(turn), t}.inverse();
}

}  // namespace apvi::vio
