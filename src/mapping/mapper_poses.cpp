// SPDX-License-Identifier: BSD-3-Clause
// Where the mapper's keyframes stand.
#include <torch/torch.h>

#include <algorithm>
#include <map>

#include "apvi/core/log.hpp"
#include "apvi/mapping/mapper.hpp"
#include "apvi/mapping/picture_alignment.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

// Smaller corrections of a pose are not worth moving Gaussians for; they add up until they are.
constexpr double kLeastMove = 5e-4;   // [m], and [rad]
constexpr int kAlignedWidth = 320;    // of the picture that a keyframe is aligned with, at least
constexpr int kRememberedFactor = 4;  // by which pictures are reduced that say what is known
constexpr double kMapKnows_m = 0.01;  // so well, where a keyframe stands on what it has seen before

double size_of(const Tensor& motion) {
  const Tensor t = motion.slice(0, 0, 3).select(1, 3);
  const Tensor R = motion.slice(0, 0, 3).slice(1, 0, 3) - torch::eye(3, torch::kFloat64);
  return std::max(t.norm().item<double>(), R.norm().item<double>());
}

}  // namespace

// Keyframes' own Gaussians keep their place before the camera.
void Mapper::move(const std::vector<MovedKeyframe>& moved) {
  std::map<std::int64_t, Tensor> motions;
  for (const MovedKeyframe& keyframe : moved) {
    const auto known = by_stamp_.find(keyframe.stamp_ns);
    if (known == by_stamp_.end() || !is_rigid(keyframe.T_camera_world)) continue;
    const Tensor motion = place(known->second, keyframe.T_camera_world);
    if (!motion.defined()) continue;
    move_followers(known->second, motion);
    motions[static_cast<std::int64_t>(known->second)] = motion;
  }
  move_gaussians(motions);
}

// How the world moves about a keyframe that odometry has elsewhere; undefined: not worth it. A
// little is drift, not a move, where the map has said how the keyframe stands on it.
Tensor Mapper::place(std::size_t i, const Tensor& T_camera_odometry) {
  const Tensor pose = drift_.in_map(i, T_camera_odometry);
  const Tensor before = keyframes_[i].T_camera_world;
  const double moved = size_of(pose.mm(rigid_inverse(before)));
  if (drift_.is_found(i) && moved < kMapKnows_m) {
    drift_.found(i, T_camera_odometry, before);
    return {};
  }
  if (moved < kLeastMove) return {};
  keyframes_.set_pose(i, pose);
  return rigid_inverse(pose).mm(before);
}

// A held-out keyframe goes with the one before it, whoever that follows in the window.
void Mapper::relocate(const std::vector<Relocated>& relocated) {
  std::map<std::int64_t, Tensor> by_time;
  for (const Relocated& place : relocated) {
    if (!is_rigid(place.motion)) return;
    by_time[place.stamp_ns] = place.motion;
  }
  if (relocated.empty()) return;
  std::map<std::int64_t, Tensor> motions;
  const Relocated& last = relocated.back();
  Tensor motion;
  for (const auto& [stamp, i] : by_stamp_) {
    if (stamp > last.stamp_ns) {
      motion = last.motion;
    } else if (!keyframes_[i].held_out) {
      const auto named = by_time.find(stamp);
      motion = named == by_time.end() ? Tensor() : named->second;
    }
    if (!motion.defined()) continue;
    drift_.relocate(i, motion);
    keyframes_.set_pose(i, keyframes_[i].T_camera_world.mm(rigid_inverse(motion)));
    if (keyframes_[i].held_out) continue;
    first_sight_.move(stamp, motion);
    motions[static_cast<std::int64_t>(i)] = motion;
  }
  move_gaussians(motions);
  drift_.relocate_next(last.motion);
}

void Mapper::move_gaussians(const std::map<std::int64_t, Tensor>& motions) {
  if (learner_) {
    within_memory([&] { learner_->move(motions); });
  }
}

// Held-out keyframes are no part of the window; they stay where its keyframes see them.
void Mapper::move_followers(std::size_t view, const Tensor& motion) {
  const auto found = followers_.find(view);
  if (found == followers_.end()) return;
  for (const std::size_t i : found->second) {
    keyframes_.set_pose(i, keyframes_[i].T_camera_world.mm(rigid_inverse(motion)));
  }
}

// What odometry may have drifted from: keyframes of some time ago, once each.
void Mapper::remember_until(std::int64_t stamp_ns) {
  const std::vector<std::size_t>& views = keyframes_.training();
  auto next = std::lower_bound(views.begin(), views.end(), remembered_);
  for (; next != views.end() && keyframes_[*next].stamp_ns < stamp_ns; ++next) {
    const Tensor own =
        (learner_->anchors() == static_cast<std::int64_t>(*next)).nonzero().squeeze(1);
    splat::Gaussians made = learner_->map();
    for (Tensor* part : made.tensors()) *part = part->index_select(0, own);
    first_sight_.remember(made, keyframes_.view(*next, kRememberedFactor),
                          keyframes_[*next].stamp_ns);
    remembered_ = *next + 1;
  }
}

// What was seen long ago says where the keyframe stands. Held-out ones are not looked at: they have
// the drift of the keyframe before them.
void Mapper::align(std::size_t view) {
  if (!options_.online.align || !learner_) return;
  const auto entry = times_.enter("alignment");
  const std::int64_t stamp = keyframes_[view].stamp_ns;
  remember_until(stamp - kLongAgo_ns);
  Map map = learner_->whole_map();
  map.gaussians = first_sight_.gaussians();
  if (map.gaussians.size() == 0) return;
  const int factor = keyframes_[view].intrinsics.width >= 2 * kAlignedWidth ? 2 : 1;
  const splat::View camera = keyframes_.view(view, factor);
  const Picture shown = take_picture(map, camera);
  const Tensor picture = keyframes_.image(view, factor, shown.alpha.device()) /
                         camera_response(map, keyframes_, view, factor);
  const auto found = align_picture(shown, picture, camera.intrinsics, drift_.sigmas(stamp));
  if (!found) return;
  const Tensor pose = found->T_camera_believed.mm(camera.T_camera_world);
  log::debug(
      "{}: stands {:.1f} mm from where odometry has it; residual {:.4f}, was {:.4f}; "
      "correlation {:.2f} over {:.0f} % of the picture",
      keyframes_[view].name, 1e3 * size_of(found->T_camera_believed), found->after, found->before,
      found->likeness, 100.0 * found->share);
  drift_.found_newest(stamp, drift_.in_odometry(view, camera.T_camera_world), pose);
  keyframes_.set_pose(view, pose);
}

}  // namespace apvi::mapping
