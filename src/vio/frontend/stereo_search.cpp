// SPDX-License-Identifier: BSD-3-Clause
#include "vio/frontend/stereo_search.hpp"

#include "core/median.hpp"
#include "vio/factors/projection.hpp"
#include "vio/frontend/epipolar_check.hpp"
#include "vio/frontend/optical_flow.hpp"

namespace apvi::vio {
namespace {

// Inverse depth in the first camera that best aligns the ray with its observation in the second.
std::optional<double> triangulate(const SE3& T_second_first, const Eigen::Vector2d& first,
                                  const Eigen::Vector2d& second) {
  const Eigen::Vector3d ray = T_second_first.rotation * first.homogeneous();
  const Eigen::Vector3d a = second.homogeneous().cross(ray);
  const Eigen::Vector3d b = second.homogeneous().cross(T_second_first.translation);
  // a + inverse_depth * b = 0
  if (b.squaredNorm() < 1e-16) return std::nullopt;
  return -a.dot(b) / b.squaredNorm();
}

}  // namespace

StereoSearch::StereoSearch(const CameraCalibration& first, const CameraCalibration& second,
                           double max_forward_backward_px, double max_epipolar_px)
    : second_(second.model),
      T_second_first_(second.T_body_camera.inverse() * first.T_body_camera),
      essential_(essential_matrix(T_second_first_.rotation, T_second_first_.translation)),
      max_backward_px_(max_forward_backward_px),
      max_epipolar_(max_epipolar_px / focal_length(second.model)) {}

cv::Point2f StereoSearch::guess(const StereoQuery& query) const {
  const double inverse_depth = query.inverse_depth.value_or(median_inverse_depth_);
  const Eigen::Vector3d p = T_second_first_.rotation * query.point.homogeneous() +
                            inverse_depth * T_second_first_.translation;
  const auto pixel = second_.project(p);
  return pixel ? to_cv(*pixel) : query.pixel;
}

std::optional<StereoMatch> StereoSearch::check(const StereoQuery& query,
                                               const cv::Point2f& pixel) const {
  constexpr double kMaxInverseDepth = 10.0;   // at 0.1 m [1/m]
  constexpr double kMinInverseDepth = -0.02;  // at infinity, with a margin for noise [1/m]
  const auto point = plane_point(second_, pixel);
  if (!point || epipolar_distance(essential_, {query.point, *point}) > max_epipolar_) {
    return std::nullopt;
  }
  const auto inverse_depth = triangulate(T_second_first_, query.point, *point);
  if (!inverse_depth || *inverse_depth < kMinInverseDepth || *inverse_depth > kMaxInverseDepth) {
    return std::nullopt;
  }
  return StereoMatch{pixel, *point, *inverse_depth};
}

std::vector<std::optional<StereoMatch>> StereoSearch::find(
    const FrameImage& first, const FrameImage& second, const std::vector<StereoQuery>& queries) {
  std::vector<cv::Point2f> from;
  std::vector<cv::Point2f> guesses;
  for (const StereoQuery& query : queries) {
    from.push_back(query.pixel);
    guesses.push_back(guess(query));
  }
  const Flow flow = compute_flow(first, second, from, guesses, guesses, max_backward_px_);
  std::vector<std::optional<StereoMatch>> matches(queries.size());
  std::vector<double> inverse_depths;
  for (std::size_t i = 0; i < queries.size(); ++i) {
    if (!flow.found[i]) continue;
    matches[i] = check(queries[i], flow.to[i]);
    if (matches[i]) inverse_depths.push_back(matches[i]->inverse_depth);
  }
  if (!inverse_depths.empty()) median_inverse_depth_ = median(std::move(inverse_depths));
  return matches;
}

}  // namespace apvi::vio
