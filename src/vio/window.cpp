// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/vio/window.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace apvi::vio {
namespace {

constexpr double kNearest = 0.05;    // of a landmark in front of a camera [m]
constexpr double kFarthest = 200.0;  // [m]

// Of a ray past the point where all of them should meet, on the plane z = 1.
constexpr double kLargestMiss = 0.03;

using Sighting = Landmark::Sighting;

Eigen::Vector3d ray(const Sighting& sighting) {
  return sighting.view.point.homogeneous();
}

// Depth in the anchor that makes the point lie nearest to all rays; nothing when the rays are too
// parallel or the point is behind a camera.
std::optional<double> intersect(const Landmark& landmark, const Window& window,
                                double min_parallax) {
  const SE3 anchor = camera_pose(landmark.sightings.front(), window);
  const Eigen::Vector3d first = (anchor.rotation * ray(landmark.sightings.front())).normalized();
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  double smallest_cosine = 1.0;
  for (const Sighting& sighting : landmark.sightings) {
    const SE3 pose = camera_pose(sighting, window);
    const Eigen::Vector3d direction = (pose.rotation * ray(sighting)).normalized();
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - direction * direction.transpose();
    A += across;
    b += across * pose.translation;
    smallest_cosine = std::min(smallest_cosine, direction.dot(first));
  }
  if (smallest_cosine > std::cos(min_parallax)) return std::nullopt;
  const Eigen::Vector3d point = A.inverse() * b;
  for (const Sighting& sighting : landmark.sightings) {
    const Eigen::Vector3d p = camera_pose(sighting, window).inverse() * point;
    if (!(p.z() > kNearest && p.z() < kFarthest)) return std::nullopt;
    if ((p.head<2>() / p.z() - sighting.view.point).norm() > kLargestMiss) return std::nullopt;
  }
  return (anchor.inverse() * point).z();
}

// The landmark loses its first sightings; its depth is carried over to the next frame's.
void drop_sightings(Landmark& landmark, const Window& window, const Frame& frame) {
  const bool anchored = landmark.sightings.front().frame == &frame;
  const bool carry = anchored && landmark.triangulated();
  const Eigen::Vector3d p = carry ? position(landmark, window) : Eigen::Vector3d::Zero();
  std::erase_if(landmark.sightings, [&](const Sighting& s) { return s.frame == &frame; });
  if (!anchored || landmark.sightings.empty()) return;
  landmark.inverse_depth = 0.0;
  if (!carry) return;
  const double z = (camera_pose(landmark.sightings.front(), window).inverse() * p).z();
  if (z > kNearest) landmark.inverse_depth = 1.0 / z;
}

}  // namespace

SE3 camera_pose(const Landmark::Sighting& sighting, const Window& window) {
  const auto camera = static_cast<std::size_t>(sighting.camera);
  return to_se3(sighting.frame->state.pose.data()) * to_se3(window.T_body_camera.at(camera).data());
}

bool takes_part(const Landmark& landmark, int min_sightings) {
  return landmark.triangulated() && static_cast<int>(landmark.sightings.size()) >= min_sightings;
}

Eigen::Vector3d position(const Landmark& landmark, const Window& window) {
  const Sighting& anchor = landmark.sightings.front();
  return camera_pose(anchor, window) * (ray(anchor) / landmark.inverse_depth);
}

void add_sightings(Window& window, Frame& frame, const TrackedFrame& tracked) {
  int tracks = 0;
  std::set<std::int64_t> still_bad;
  for (const Observation& seen : tracked.observations) {
    if (window.given_up.contains(seen.id)) {
      still_bad.insert(seen.id);
      continue;
    }
    if (seen.camera == 0) ++tracks;
    window.landmarks[seen.id].sightings.push_back(
        {&frame, seen.camera, {seen.point, seen.velocity}, seen.track_length});
  }
  window.given_up = std::move(still_bad);
  frame.tracks = tracks;
}

void remove_sightings(Window& window, const Frame& frame) {
  for (auto& [id, landmark] : window.landmarks) {
    const auto of_frame = [&](const Landmark::Sighting& seen) { return seen.frame == &frame; };
    if (std::ranges::any_of(landmark.sightings, of_frame)) drop_sightings(landmark, window, frame);
  }
  remove_unseen(window);
}

void end_doubt(Window& window) {
  const Frame* newest = &window.newest();
  for (auto& [id, landmark] : window.landmarks) {
    if (landmark.sightings.front().frame->doubtful) landmark.inverse_depth = 0.0;  // never solved
    if (landmark.sightings.back().frame == newest) continue;
    while (!landmark.sightings.empty() && landmark.sightings.back().frame->doubtful) {
      drop_sightings(landmark, window, *landmark.sightings.back().frame);
    }
  }
  remove_unseen(window);
  for (const auto& frame : window.frames) frame->doubtful = false;
}

void triangulate(Window& window, double min_parallax) {
  for (auto& [id, landmark] : window.landmarks) {
    if (landmark.triangulated() || landmark.sightings.size() < 2) continue;
    if (const auto depth = intersect(landmark, window, min_parallax)) {
      landmark.inverse_depth = 1.0 / *depth;
    }
  }
}

void remove_frame(Window& window, std::size_t index) {
  remove_sightings(window, *window.frames[index]);
  window.frames.erase(window.frames.begin() + static_cast<std::ptrdiff_t>(index));
  if (index < window.frames.size()) window.frames[index]->from_previous.reset();
}

void remove_unseen(Window& window) {
  std::erase_if(window.landmarks, [](const auto& entry) { return entry.second.sightings.empty(); });
}

}  // namespace apvi::vio
