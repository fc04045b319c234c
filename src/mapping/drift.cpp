// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/drift.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/seeds.hpp"
#include "archive.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

// Drift is thought possible as if so much time had passed, at least and at most [s].
constexpr double kLeastTime_s = 0.5;
constexpr double kMostTime_s = 30.0;

/// The rigid motion nearest to a product of many, whose rounding adds up.
Tensor rigid(Tensor T) {
  const Tensor R = T.slice(0, 0, 3).slice(1, 0, 3);
  const auto [U, S, Vh] = torch::linalg_svd(R);
  R.copy_(U.mm(Vh));
  return T;
}

}  // namespace

void Drift::add() {
  keyframes_.push_back({.T_odometry_map = now_, .found = false});
}

Tensor Drift::in_map(std::size_t i, const Tensor& T_camera_odometry) const {
  return T_camera_odometry.mm(keyframes_.at(i).T_odometry_map);
}

Tensor Drift::in_odometry(std::size_t i, const Tensor& T_camera_map) const {
  return T_camera_map.mm(rigid_inverse(keyframes_.at(i).T_odometry_map));
}

Tensor Drift::points_in_map(const Tensor& points) const {
  return moved(rigid_inverse(now_), points);
}

PoseSigmas Drift::sigmas(std::int64_t stamp_ns) const {
  const double passed = 1e-9 * static_cast<double>(stamp_ns - last_found_ns_);
  const double time = std::clamp(passed, kLeastTime_s, kMostTime_s);
  return {.translation_m = time * each_second_.translation_m,
          .rotation_rad = time * each_second_.rotation_rad};
}

void Drift::found_newest(std::int64_t stamp_ns, const Tensor& T_camera_odometry,
                         const Tensor& T_camera_map) {
  found(keyframes_.size() - 1, T_camera_odometry, T_camera_map);
  now_ = keyframes_.back().T_odometry_map;
  last_found_ns_ = stamp_ns;
}

void Drift::found(std::size_t i, const Tensor& T_camera_odometry, const Tensor& T_camera_map) {
  keyframes_.at(i) = {.T_odometry_map = rigid(rigid_inverse(T_camera_odometry).mm(T_camera_map)),
                      .found = true};
}

void Drift::relocate(std::size_t i, const Tensor& motion) {
  Tensor& T = keyframes_.at(i).T_odometry_map;
  T = rigid(T.mm(rigid_inverse(motion)));
}

void Drift::relocate_next(const Tensor& motion) {
  now_ = rigid(now_.mm(rigid_inverse(motion)));
}

void Drift::save(torch::serialize::OutputArchive& archive) const {
  archive.write("now", now_);
  archive.write("last_found", c10::IValue(last_found_ns_));
  Tensor poses =
      torch::empty({static_cast<std::int64_t>(keyframes_.size()), 4, 4}, torch::kFloat64);
  Tensor found = torch::empty({poses.size(0)}, torch::kBool);
  for (std::int64_t i = 0; i < poses.size(0); ++i) {
    const Entry& entry = keyframes_[static_cast<std::size_t>(i)];
    poses[i] = entry.T_odometry_map;
    found[i] = entry.found;
  }
  archive.write("T_odometry_map", poses);
  archive.write("found", found);
}

void Drift::load(torch::serialize::InputArchive& archive) {
  archive.read("now", now_);
  last_found_ns_ = read_int(archive, "last_found");
  Tensor poses;
  Tensor found;
  archive.read("T_odometry_map", poses);
  archive.read("found", found);
  keyframes_.clear();
  for (std::int64_t i = 0; i < poses.size(0); ++i) {
    keyframes_.push_back({.T_odometry_map = poses[i].clone(), .found = found[i].item<bool>()});
  }
}

}  // namespace apvi::mapping
