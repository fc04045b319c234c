// SPDX-License-Identifier: BSD-3-Clause
// Mapper: keyframe poses.
#include <torch/torch.h>

#include <algorithm>
#include <map>

#include "apvi/core/log.hpp"
#include "mapping/alignment/image_alignment.hpp"
#include "mapping/mapper.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

// Smaller pose updates do not move Gaussians; they accumulate until they exceed the threshold.
constexpr double kMinMotion = 5e-4;  // [m] and [rad]
constexpr int kMinAlignmentWidth_px = 320;
constexpr int kReferenceReduction = 4;           // image reduction for the reference map's coverage
constexpr double kRegisteredTolerance_m = 0.01;  // accuracy of a keyframe registered to the map

double size_of(const Tensor& motion) {
  const Tensor t = motion.slice(0, 0, 3).select(1, 3);
  const Tensor R = motion.slice(0, 0, 3).slice(1, 0, 3) - torch::eye(3, torch::kFloat64);
  return std::max(t.norm().item<double>(), R.norm().item<double>());
}

}  // namespace

// Gaussians move with their keyframe.
void Mapper::apply_pose_updates(const std::vector<MovedKeyframe>& moved) {
  std::map<std::int64_t, Tensor> motions;
  for (const MovedKeyframe& keyframe : moved) {
    const auto known = by_stamp_.find(keyframe.stamp_ns);
    if (known == by_stamp_.end() || !is_rigid(keyframe.T_camera_world)) continue;
    const Tensor motion = update_pose(known->second, keyframe.T_camera_world);
    if (!motion.defined()) continue;
    move_followers(known->second, motion);
    motions[static_cast<std::int64_t>(known->second)] = motion;
  }
  move_gaussians(motions);
}

// Motion of the world around a keyframe with a new odometry pose; undefined when negligible. For a
// keyframe registered to the map, a small change is absorbed by the map-odometry transform.
Tensor Mapper::update_pose(std::size_t i, const Tensor& T_camera_odometry) {
  const Tensor pose = map_odom_.pose_in_map(i, T_camera_odometry);
  const Tensor before = keyframes_[i].T_camera_world;
  const double moved = size_of(pose.mm(rigid_inverse(before)));
  if (map_odom_.is_registered(i) && moved < kRegisteredTolerance_m) {
    map_odom_.set_registered(i, T_camera_odometry, before);
    return {};
  }
  if (moved < kMinMotion) return {};
  keyframes_.set_pose(i, pose);
  return rigid_inverse(pose).mm(before);
}

// A held-out image moves with the preceding keyframe.
void Mapper::apply_loop_corrections(const std::vector<LoopCorrection>& loop_corrections) {
  std::map<std::int64_t, Tensor> by_time;
  for (const LoopCorrection& correction : loop_corrections) {
    if (!is_rigid(correction.motion)) return;
    by_time[correction.stamp_ns] = correction.motion;
  }
  if (loop_corrections.empty()) return;
  std::map<std::int64_t, Tensor> motions;
  const LoopCorrection& last = loop_corrections.back();
  Tensor motion;
  for (const auto& [stamp, i] : by_stamp_) {
    if (stamp > last.stamp_ns) {
      motion = last.motion;
    } else if (!keyframes_[i].held_out) {
      const auto listed = by_time.find(stamp);
      motion = listed == by_time.end() ? Tensor() : listed->second;
    }
    if (!motion.defined()) continue;
    map_odom_.apply_correction(i, motion);
    keyframes_.set_pose(i, keyframes_[i].T_camera_world.mm(rigid_inverse(motion)));
    if (keyframes_[i].held_out) continue;
    reference_map_.move(stamp, motion);
    motions[static_cast<std::int64_t>(i)] = motion;
  }
  move_gaussians(motions);
  map_odom_.correct_current(last.motion);
}

void Mapper::move_gaussians(const std::map<std::int64_t, Tensor>& motions) {
  if (optimizer_) {
    retry_on_oom([&] { optimizer_->move(motions); });
  }
}

// Held-out images are not in the odometry window; they move with their leading keyframe.
void Mapper::move_followers(std::size_t view, const Tensor& motion) {
  const auto found = followers_.find(view);
  if (found == followers_.end()) return;
  for (const std::size_t i : found->second) {
    keyframes_.set_pose(i, keyframes_[i].T_camera_world.mm(rigid_inverse(motion)));
  }
}

// Adds the Gaussians of keyframes older than the stamp, once each.
void Mapper::update_reference_map(std::int64_t stamp_ns) {
  const std::vector<std::size_t>& views = keyframes_.training();
  auto next = std::lower_bound(views.begin(), views.end(), reference_end_);
  for (; next != views.end() && keyframes_[*next].stamp_ns < stamp_ns; ++next) {
    const Tensor own =
        (optimizer_->anchors() == static_cast<std::int64_t>(*next)).nonzero().squeeze(1);
    gaussians::Gaussians own_gaussians = optimizer_->map();
    for (Tensor* part : own_gaussians.tensors()) *part = part->index_select(0, own);
    reference_map_.insert(own_gaussians, keyframes_.view(*next, kReferenceReduction),
                          keyframes_[*next].stamp_ns);
    reference_end_ = *next + 1;
  }
}

// Registers the keyframe to the frozen reference map. Held-out images are not aligned; they share
// the drift of the preceding keyframe.
void Mapper::align(std::size_t view) {
  if (!options_.online.align || !optimizer_) return;
  const auto entry = times_.scope("alignment");
  const std::int64_t stamp = keyframes_[view].stamp_ns;
  update_reference_map(stamp - kReferenceAge_ns);
  Map map = optimizer_->full_map();
  map.gaussians = reference_map_.gaussians();
  if (map.gaussians.size() == 0) return;
  const int factor = keyframes_[view].intrinsics.width >= 2 * kMinAlignmentWidth_px ? 2 : 1;
  const gaussians::View camera = keyframes_.view(view, factor);
  const MapRendering rendering = render_map(map, camera);
  const Tensor image = keyframes_.image(view, factor, rendering.alpha.device()) /
                       camera_response(map, keyframes_, view, factor);
  const auto alignment = align_image(rendering, image, camera.intrinsics, map_odom_.sigmas(stamp));
  if (!alignment) return;
  const Tensor pose = alignment->T_camera_prior.mm(camera.T_camera_world);
  log::debug(
      "{}: aligned to the map, moved by {:.1f} mm; residual {:.4f}, was {:.4f}; "
      "correlation {:.2f} over {:.0f} % of the image",
      keyframes_[view].name, 1e3 * size_of(alignment->T_camera_prior), alignment->residual_after,
      alignment->residual_before, alignment->correlation, 100.0 * alignment->overlap);
  map_odom_.register_newest(stamp, map_odom_.pose_in_odometry(view, camera.T_camera_world), pose);
  keyframes_.set_pose(view, pose);
}

}  // namespace apvi::mapping
