// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/map_anchors.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "apvi/core/log.hpp"

namespace apvi::loop_closure {
namespace {

// The points of a map err alike, so that the errors of a pose exceed what their number promises.
constexpr double kErrorFactor = 3.0;
constexpr double kMinSigma_m = 0.01;
constexpr double kMinHeadingSigma = 1e-3;

// In the axes of the known map.
Eigen::Matrix4d covariance_in_map(const LevelPose& pose) {
  Eigen::Matrix4d R = Eigen::Matrix4d::Identity();
  R.topLeftCorner<3, 3>() = pose.T_world_map.rotation.conjugate().toRotationMatrix();
  Eigen::Vector4d least = Eigen::Vector4d::Constant(kMinSigma_m * kMinSigma_m);
  least[3] = kMinHeadingSigma * kMinHeadingSigma;
  Eigen::Matrix4d covariance = kErrorFactor * kErrorFactor * R * pose.covariance * R.transpose();
  covariance.diagonal() += least;
  return covariance;
}

EdgeSigmas sigmas_of(const Eigen::Matrix4d& covariance) {
  const Eigen::Vector4d sigmas = covariance.diagonal().cwiseSqrt();
  return {.heading_rad = sigmas[3],
          .horizontal_m = std::max(sigmas[0], sigmas[1]),
          .vertical_m = sigmas[2]};
}

}  // namespace

Anchor anchor_of(std::size_t keyframe, const MapFix& fix) {
  return {.keyframe = keyframe,
          .T_known_camera = fix.pose.T_world_map.inverse() * fix.view.T_world_camera,
          .sigmas = sigmas_of(covariance_in_map(fix.pose))};
}

MapAnchors::MapAnchors(std::shared_ptr<const KnownMap> map, double gate)
    : map_(std::move(map)), relocalizer_(map_->sigma()), gate_(gate) {}

bool MapAnchors::process(const Place& place, KeyframeGraph& graph) {
  return is_searching() ? search(place, graph) : anchor(place, graph);
}

bool MapAnchors::search(const Place& place, KeyframeGraph& graph) {
  const std::size_t newest = graph.newest();
  const SE3 T_world_camera = graph[newest].T_world_camera;
  const auto result = relocalizer_.add(newest, map_->find(place, T_world_camera));
  if (!result) return false;
  graph.add_known_map(graph.correction(newest).transform() * result->pose.T_world_map);
  for (const KnownKeyframe& image : result->images) {
    graph.add(anchor_of(image.keyframe, image.fix));
  }
  anchors_ = result->images.size();
  found_ = FoundInMap{.stamp = graph[newest].stamp,
                      .images = anchors_,
                      .features = result->images.back().fix.features,
                      .points = result->points,
                      .T_known_camera = result->pose.T_world_map.inverse() * T_world_camera,
                      .covariance = covariance_in_map(result->pose)};
  log::info("found in the known map: {} images agree, by {} of its points", anchors_,
            found_->points);
  return true;
}

bool MapAnchors::anchor(const Place& place, KeyframeGraph& graph) {
  const std::size_t newest = graph.newest();
  const auto fix = map_->find_near(place, graph.corrected_pose(newest), graph.T_world_known());
  if (!fix) return false;
  const Anchor anchor = anchor_of(newest, *fix);
  const bool accepted = graph.check(anchor).squared_distance < gate_;
  accepted ? ++anchors_ : ++rejected_;
  if (accepted) graph.add(anchor);
  return accepted;
}

}  // namespace apvi::loop_closure
