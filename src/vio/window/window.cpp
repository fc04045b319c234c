// SPDX-License-Identifier: BSD-3-Clause
#include "vio/window/window.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "apvi/geometry/scale_change.hpp"

namespace apvi::vio {
namespace {

constexpr double kMinDepth_m = 0.05;   // landmark depth range [m]
constexpr double kMaxDepth_m = 200.0;  // [m]

// Maximum distance of the triangulated point from a ray, on the plane z = 1.
constexpr double kMaxRayMiss = 0.03;

using Observation = Landmark::Observation;

// Depth in the anchor camera of the point nearest to all rays; nullopt if the parallax is too small
// or the point is behind a camera.
std::optional<double> triangulate_depth(const Landmark& landmark, const Window& window,
                                        double min_parallax) {
  const SE3 anchor = camera_pose(landmark.observations.front(), window);
  const Eigen::Vector3d first =
      (anchor.rotation * ray(landmark.observations.front(), window)).normalized();
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  double smallest_cosine = 1.0;
  for (const Observation& observation : landmark.observations) {
    const SE3 pose = camera_pose(observation, window);
    const Eigen::Vector3d direction = (pose.rotation * ray(observation, window)).normalized();
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - direction * direction.transpose();
    A += across;
    b += across * pose.translation;
    smallest_cosine = std::min(smallest_cosine, direction.dot(first));
  }
  if (smallest_cosine > std::cos(min_parallax)) return std::nullopt;
  const Eigen::Vector3d point = A.inverse() * b;
  for (const Observation& observation : landmark.observations) {
    const Eigen::Vector3d p = camera_pose(observation, window).inverse() * point;
    if (!(p.z() > kMinDepth_m && p.z() < kMaxDepth_m)) return std::nullopt;
    if ((p / p.z() - ray(observation, window)).norm() > kMaxRayMiss) return std::nullopt;
  }
  return (anchor.inverse() * point).z();
}

// Removes the observations of a frame from a landmark; if it was the anchor, the depth is
// transferred to the new anchor.
void drop_observations(Landmark& landmark, const Window& window, const Frame& frame) {
  const bool anchored = landmark.observations.front().frame == &frame;
  const bool carry = anchored && landmark.triangulated();
  const Eigen::Vector3d p = carry ? position(landmark, window) : Eigen::Vector3d::Zero();
  std::erase_if(landmark.observations, [&](const Observation& s) { return s.frame == &frame; });
  if (!anchored || landmark.observations.empty()) return;
  landmark.inverse_depth = 0.0;
  if (!carry) return;
  const double z = (camera_pose(landmark.observations.front(), window).inverse() * p).z();
  if (z > kMinDepth_m) landmark.inverse_depth = 1.0 / z;
}

}  // namespace

Eigen::Vector3d ray(const Landmark::Observation& observation, const Window& window) {
  const auto camera = static_cast<std::size_t>(observation.camera);
  return true_point(observation.view.point, window.calibration.lenses.at(camera)).homogeneous();
}

SE3 camera_pose(const Landmark::Observation& observation, const Window& window) {
  const auto camera = static_cast<std::size_t>(observation.camera);
  return to_se3(observation.frame->state.pose.data()) *
         observation.view.motion.shift(window.calibration.camera_time_offset_s) *
         to_se3(window.calibration.T_body_camera.at(camera).data());
}

bool is_in_graph(const Landmark& landmark, int min_observations) {
  return landmark.triangulated() &&
         static_cast<int>(landmark.observations.size()) >= min_observations;
}

Eigen::Vector3d position(const Landmark& landmark, const Window& window) {
  const Observation& anchor = landmark.observations.front();
  return camera_pose(anchor, window) * (ray(anchor, window) / landmark.inverse_depth);
}

Window empty_window(const Rig& rig) {
  Window window;
  window.calibration = calibration_of(rig);
  return window;
}

void add_observations(Window& window, Frame& frame, const TrackedFrame& tracked) {
  int tracks = 0;
  std::set<std::int64_t> still_bad;
  for (const FeatureObservation& seen : tracked.observations) {
    if (window.rejected_tracks.contains(seen.id)) {
      still_bad.insert(seen.id);
      continue;
    }
    if (seen.camera == 0) ++tracks;
    window.landmarks[seen.id].observations.push_back(
        {&frame, seen.camera, {seen.point, frame.motion}, seen.track_length});
  }
  window.rejected_tracks = std::move(still_bad);
  frame.tracks = tracks;
}

void remove_observations(Window& window, const Frame& frame) {
  for (auto& [id, landmark] : window.landmarks) {
    const auto of_frame = [&](const Landmark::Observation& seen) { return seen.frame == &frame; };
    if (std::ranges::any_of(landmark.observations, of_frame))
      drop_observations(landmark, window, frame);
  }
  remove_unobserved(window);
}

void restore_excluded_frames(Window& window) {
  const Frame* newest = &window.newest();
  for (auto& [id, landmark] : window.landmarks) {
    if (landmark.observations.front().frame->vision_excluded)
      landmark.inverse_depth = 0.0;  // never solved
    if (landmark.observations.back().frame == newest) continue;
    while (!landmark.observations.empty() && landmark.observations.back().frame->vision_excluded) {
      drop_observations(landmark, window, *landmark.observations.back().frame);
    }
  }
  remove_unobserved(window);
  for (const auto& frame : window.frames) frame->vision_excluded = false;
}

void triangulate(Window& window, double min_parallax) {
  for (auto& [id, landmark] : window.landmarks) {
    if (landmark.triangulated() || landmark.observations.size() < 2) continue;
    if (const auto depth = triangulate_depth(landmark, window, min_parallax)) {
      landmark.inverse_depth = 1.0 / *depth;
    }
  }
}

void scale_lengths(Window& window, double factor) {
  const Eigen::Vector3d p_body_camera =
      to_se3(window.calibration.T_body_camera.front().data()).translation;
  for (const auto& frame : window.frames) {
    const SE3 pose = to_se3(frame->state.pose.data());
    frame->state.pose = to_block(changed({.scale = factor}, pose, p_body_camera));
  }
  for (auto& [id, landmark] : window.landmarks) landmark.inverse_depth /= factor;
}

void remove_frame(Window& window, std::size_t index) {
  remove_observations(window, *window.frames[index]);
  window.frames.erase(window.frames.begin() + static_cast<std::ptrdiff_t>(index));
  if (index < window.frames.size()) window.frames[index]->from_previous.reset();
}

void remove_unobserved(Window& window) {
  std::erase_if(window.landmarks,
                [](const auto& entry) { return entry.second.observations.empty(); });
}

}  // namespace apvi::vio
