// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/place.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "apvi/core/constants.hpp"
#include "sensors/camera_mask.hpp"
#include "sensors/reduced_camera.hpp"

namespace apvi::loop_closure {
namespace {

constexpr double kSiftContrast =
    0.01;  // SIFT contrast threshold; the usual 0.04 finds few features in turbid water
constexpr double kClaheClipLimit = 3.0;  // of CLAHE
const cv::Size kClaheTiles(8, 8);
constexpr int kMaxImageSide_px = 1280;
constexpr int kMaskMargin_px = 8;  // of features, which are described by what is around them
constexpr float kMaxRatio = 0.8F;  // Lowe's ratio test
// How fast the number of SIFT matches falls with the angle between two views and with their scale.
constexpr double kViewSigma = 15.0 * kRadiansPerDegree;
constexpr double kScaleSigma = 0.4;        // [octaves]
constexpr double kMaxDistanceRatio = 2.0;  // limit on the change of distance, either way
constexpr double kInlierSigmas = 3.0;      // inlier threshold of a ray
constexpr double kMinParallax = 0.02;      // of two rays to be triangulated [rad]
constexpr int kRansacIterations = 200;
constexpr double kConfidence = 0.999;
constexpr double kMinInlierFraction = 0.4;  // minimum inlier fraction of the matches

using Descriptors = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Descriptors numbers(const cv::Mat& descriptors) {
  using Bytes = Eigen::Matrix<unsigned char, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return Eigen::Map<const Bytes>(descriptors.ptr<unsigned char>(), descriptors.rows,
                                 descriptors.cols)
      .cast<float>();
}

/// Index of the smallest squared distance of a row or column if it passes the ratio test; else -1.
template <typename Distances>
Eigen::Index ratio_test_minimum(const Distances& squared) {
  Eigen::Index nearest = 0;
  const float smallest = squared.minCoeff(&nearest);
  float second = std::numeric_limits<float>::infinity();
  for (Eigen::Index k = 0; k < squared.size(); ++k) {
    if (k != nearest) second = std::min(second, squared[k]);
  }
  return smallest < kMaxRatio * kMaxRatio * second ? nearest : -1;
}

// Midpoint of the shortest segment between two rays, in the frame of the first camera (Hartley and
// Sturm, Triangulation, 1997, section 4.1); accurate enough for rays that nearly intersect.
std::optional<Eigen::Vector3d> triangulate_midpoint(const Eigen::Vector2d& ray,
                                                    const Eigen::Vector2d& other,
                                                    const SE3& T_other_first, double tolerance) {
  const SE3 T_first_other = T_other_first.inverse();
  const Eigen::Vector3d d1 = ray.homogeneous().normalized();
  const Eigen::Vector3d d2 = T_first_other.rotation * other.homogeneous().normalized();
  const Eigen::Vector3d between = T_first_other.translation;
  const double cosine = d1.dot(d2);
  const double square = 1.0 - cosine * cosine;
  if (square < kMinParallax * kMinParallax) return std::nullopt;
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

std::size_t Place::triangulated_count() const {
  return static_cast<std::size_t>(
      std::count_if(points.begin(), points.end(), [](const auto& p) { return p.has_value(); }));
}

double Place::reach_m() const {
  double farthest = 0.0;
  for (const auto& point : points) {
    if (point) farthest = std::max(farthest, point->norm());
  }
  return farthest;
}

cv::Mat to_gray(const cv::Mat& image) {
  if (image.channels() != 3) return image;
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

CameraModel feature_camera(const CameraModel& camera) {
  return reduced(camera, reduction_of(camera, kMaxImageSide_px));
}

Place describe_place(const cv::Mat& gray, const CameraModel& recorded, int max_features,
                     const cv::Mat& mask) {
  const CameraModel camera = feature_camera(recorded);
  const int by = reduction_of(recorded, kMaxImageSide_px);
  cv::Mat equalized;
  cv::createCLAHE(kClaheClipLimit, kClaheTiles)->apply(reduced(gray, by), equalized);
  std::vector<cv::KeyPoint> found;
  cv::Mat descriptors;
  cv::SIFT::create(max_features, 3, kSiftContrast)
      ->detectAndCompute(equalized, reduced_mask(mask, by, kMaskMargin_px), found, descriptors);
  Place place;
  cv::Mat kept;
  for (std::size_t i = 0; i < found.size(); ++i) {
    const auto ray = camera.unproject({found[i].pt.x, found[i].pt.y});
    if (!ray || ray->z() <= 0.0) continue;
    place.rays.emplace_back(ray->hnormalized());
    kept.push_back(descriptors.row(static_cast<int>(i)));
  }
  kept.convertTo(place.descriptors, CV_8U);
  place.points.resize(place.rays.size());
  return place;
}

int squared_distance(const unsigned char* a, const unsigned char* b) {
  int sum = 0;
  for (int k = 0; k < kDescriptorSize; ++k) {
    const int difference = static_cast<int>(a[k]) - static_cast<int>(b[k]);
    sum += difference * difference;
  }
  return sum;
}

double match_probability(const Eigen::Vector3d& then, const Eigen::Vector3d& now) {
  const double angle = std::atan2(then.cross(now).norm(), then.dot(now));
  const double octaves = std::log2(now.norm() / then.norm());
  return std::exp(-0.5 * (angle * angle / (kViewSigma * kViewSigma) +
                          octaves * octaves / (kScaleSigma * kScaleSigma)));
}

VisiblePart visible_part(const Place& then, const SE3& T_now_then, const CameraModel& camera) {
  VisiblePart visible;
  std::size_t points = 0;
  std::size_t in_image = 0;
  for (const auto& point : then.points) {
    if (!point) continue;
    ++points;
    const Eigen::Vector3d p = T_now_then * *point;
    if (p.z() * kMaxDistanceRatio < point->z() || p.z() > kMaxDistanceRatio * point->z()) continue;
    const auto pixel = camera.project(p);
    if (!pixel || !camera.in_image(*pixel)) continue;
    ++in_image;
    visible.matches += match_probability(T_now_then.rotation * *point, p);
  }
  visible.fraction =
      static_cast<double>(in_image) / static_cast<double>(std::max<std::size_t>(1, points));
  return visible;
}

// All squared distances as one matrix product; exact, as descriptors are integers.
std::vector<std::pair<int, int>> match_features(const Place& a, const Place& b) {
  std::vector<std::pair<int, int>> pairs;
  if (a.descriptors.rows < 2 || b.descriptors.rows < 2) return pairs;
  const Descriptors da = numbers(a.descriptors);
  const Descriptors db = numbers(b.descriptors);
  Eigen::MatrixXf squared = -2.0F * da * db.transpose();
  squared.colwise() += da.rowwise().squaredNorm();
  squared.rowwise() += db.rowwise().squaredNorm().transpose();
  for (Eigen::Index j = 0; j < squared.cols(); ++j) {
    const Eigen::Index i = ratio_test_minimum(squared.col(j));
    if (i >= 0 && ratio_test_minimum(squared.row(i)) == j) {
      pairs.emplace_back(static_cast<int>(i), static_cast<int>(j));
    }
  }
  return pairs;
}

void triangulate_points(Place& place, const Place& other, const SE3& T_other_place, double sigma) {
  for (const auto& [i, j] : match_features(place, other)) {
    auto& point = place.points[static_cast<std::size_t>(i)];
    if (point) continue;
    point = triangulate_midpoint(place.rays[static_cast<std::size_t>(i)],
                                 other.rays[static_cast<std::size_t>(j)], T_other_place,
                                 kInlierSigmas * sigma);
  }
}

void retriangulate_points(Place& place, const Place& other, const SE3& T_other_place,
                          double sigma) {
  for (const auto& [i, j] : match_features(place, other)) {
    const auto point = triangulate_midpoint(place.rays[static_cast<std::size_t>(i)],
                                            other.rays[static_cast<std::size_t>(j)], T_other_place,
                                            kInlierSigmas * sigma);
    if (point) place.points[static_cast<std::size_t>(i)] = point;
  }
}

std::optional<PlaceMatch> recognize_place(const Place& then, const Place& now, double sigma,
                                          int min_inliers) {
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> rays;
  for (const auto& [i, j] : match_features(then, now)) {
    const auto& point = then.points[static_cast<std::size_t>(i)];
    if (!point) continue;
    points.emplace_back(point->x(), point->y(), point->z());
    const Eigen::Vector2d& ray = now.rays[static_cast<std::size_t>(j)];
    rays.emplace_back(ray.x(), ray.y());
  }
  const int count = static_cast<int>(points.size());
  if (count < min_inliers) return std::nullopt;
  const cv::Mat K = cv::Mat::eye(3, 3, CV_64F);
  cv::Mat rotation;
  cv::Mat translation;
  std::vector<int> inliers;
  const bool found = cv::solvePnPRansac(
      points, rays, K, cv::noArray(), rotation, translation, false, kRansacIterations,
      static_cast<float>(kInlierSigmas * sigma), kConfidence, inliers, cv::SOLVEPNP_EPNP);
  const int inlier_count = static_cast<int>(inliers.size());
  if (!found || inlier_count < min_inliers || inlier_count < kMinInlierFraction * count)
    return std::nullopt;
  std::vector<cv::Point3d> good_points;
  std::vector<cv::Point2d> good_rays;
  std::vector<PointOnRay> seen;
  for (const int k : inliers) {
    const cv::Point3d& point = good_points.emplace_back(points[static_cast<std::size_t>(k)]);
    const cv::Point2d& ray = good_rays.emplace_back(rays[static_cast<std::size_t>(k)]);
    seen.push_back({{point.x, point.y, point.z}, {ray.x, ray.y}});
  }
  cv::solvePnPRefineLM(good_points, good_rays, K, cv::noArray(), rotation, translation);
  return PlaceMatch{to_pose(rotation, translation), inlier_count, count, std::move(seen)};
}

}  // namespace apvi::loop_closure
