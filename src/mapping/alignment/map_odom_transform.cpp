// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/alignment/map_odom_transform.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "gaussians/model/archive.hpp"
#include "mapping/density/seeds.hpp"
#include "mapping/keyframes/keyframe_store.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

// Bounds of the time over which drift accumulates [s].
constexpr double kMinTime_s = 0.5;
constexpr double kMaxTime_s = 30.0;

/// The nearest rigid motion; long products accumulate rounding errors.
Tensor rigid(Tensor T) {
  const Tensor R = T.slice(0, 0, 3).slice(1, 0, 3);
  const auto [U, S, Vh] = torch::linalg_svd(R);
  R.copy_(U.mm(Vh));
  return T;
}

}  // namespace

Tensor rescaled_pose(const Tensor& T_camera_world, const gaussians::ScaleChange& change) {
  const Tensor& center = change.center;
  Tensor T = T_camera_world.clone();
  const Tensor R = T.slice(0, 0, 3).slice(1, 0, 3);
  Tensor t = T.slice(0, 0, 3).select(1, 3);
  t.copy_(change.scale * t + (change.scale - 1.0) * R.mv(center));
  return T;
}

void MapOdomTransform::add() {
  keyframes_.push_back({.T_odometry_map = current_, .registered = false});
}

Tensor MapOdomTransform::pose_in_map(std::size_t i, const Tensor& T_camera_odometry) const {
  return T_camera_odometry.mm(keyframes_.at(i).T_odometry_map);
}

Tensor MapOdomTransform::pose_in_odometry(std::size_t i, const Tensor& T_camera_map) const {
  return T_camera_map.mm(rigid_inverse(keyframes_.at(i).T_odometry_map));
}

Tensor MapOdomTransform::points_in_map(const Tensor& points) const {
  return transform_points(rigid_inverse(current_), points);
}

PoseSigmas MapOdomTransform::sigmas(std::int64_t stamp_ns) const {
  const double passed = 1e-9 * static_cast<double>(stamp_ns - last_registered_ns_);
  const double time = std::clamp(passed, kMinTime_s, kMaxTime_s);
  return {.translation_m = time * drift_per_second_.translation_m,
          .rotation_rad = time * drift_per_second_.rotation_rad};
}

void MapOdomTransform::register_newest(std::int64_t stamp_ns, const Tensor& T_camera_odometry,
                                       const Tensor& T_camera_map) {
  set_registered(keyframes_.size() - 1, T_camera_odometry, T_camera_map);
  current_ = keyframes_.back().T_odometry_map;
  last_registered_ns_ = stamp_ns;
}

void MapOdomTransform::set_registered(std::size_t i, const Tensor& T_camera_odometry,
                                      const Tensor& T_camera_map) {
  keyframes_.at(i) = {.T_odometry_map = rigid(rigid_inverse(T_camera_odometry).mm(T_camera_map)),
                      .registered = true};
}

void MapOdomTransform::apply_correction(std::size_t i, const Tensor& motion) {
  Tensor& T = keyframes_.at(i).T_odometry_map;
  T = rigid(T.mm(rigid_inverse(motion)));
}

void MapOdomTransform::correct_current(const Tensor& motion) {
  current_ = rigid(current_.mm(rigid_inverse(motion)));
}

// Both frames change about the same point: T' maps center + s (p - center) as T maps p.
void MapOdomTransform::change_scale(const gaussians::ScaleChange& change) {
  const Tensor& center = change.center;
  const auto rescale = [&](Tensor& T) {
    const Tensor moved = T.slice(0, 0, 3).slice(1, 0, 3).mv(center) + T.slice(0, 0, 3).select(1, 3);
    T = T.clone();
    const Tensor fixed = center + change.scale * (moved - center);
    T.slice(0, 0, 3).select(1, 3).copy_(fixed - T.slice(0, 0, 3).slice(1, 0, 3).mv(center));
  };
  rescale(current_);
  for (Entry& entry : keyframes_) rescale(entry.T_odometry_map);
}

void MapOdomTransform::save(torch::serialize::OutputArchive& archive) const {
  archive.write("current", current_);
  archive.write("last_registered", c10::IValue(last_registered_ns_));
  Tensor poses =
      torch::empty({static_cast<std::int64_t>(keyframes_.size()), 4, 4}, torch::kFloat64);
  Tensor registered = torch::empty({poses.size(0)}, torch::kBool);
  for (std::int64_t i = 0; i < poses.size(0); ++i) {
    const Entry& entry = keyframes_[static_cast<std::size_t>(i)];
    poses[i] = entry.T_odometry_map;
    registered[i] = entry.registered;
  }
  archive.write("T_odometry_map", poses);
  archive.write("registered", registered);
}

void MapOdomTransform::load(torch::serialize::InputArchive& archive) {
  archive.read("current", current_);
  last_registered_ns_ = gaussians::read_int(archive, "last_registered");
  Tensor poses;
  Tensor registered;
  archive.read("T_odometry_map", poses);
  archive.read("registered", registered);
  keyframes_.clear();
  for (std::int64_t i = 0; i < poses.size(0); ++i) {
    keyframes_.push_back(
        {.T_odometry_map = poses[i].clone(), .registered = registered[i].item<bool>()});
  }
}

}  // namespace apvi::mapping
