// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/alignment/keyframe_poses.hpp"

#include <torch/torch.h>

namespace apvi::mapping {
namespace {

using torch::Tensor;

// Smaller pose updates do not move Gaussians; they accumulate until they exceed the threshold.
constexpr double kMinMotion = 5e-4;              // [m] and [rad]
constexpr double kRegisteredTolerance_m = 0.01;  // accuracy of a keyframe registered to the map

void move_keyframe(KeyframeStore& keyframes, std::size_t i, const Tensor& motion) {
  keyframes.set_pose(i, keyframes[i].T_camera_world.mm(rigid_inverse(motion)));
}

}  // namespace

void KeyframePoses::add(const Keyframe& keyframe, KeyframeStore& keyframes) {
  const std::size_t next = keyframes.size();
  keyframes.add(keyframe);
  map_odom_.add();
  keyframes.set_pose(next, map_odom_.pose_in_map(next, keyframe.T_camera_world));
}

KeyframeMotions KeyframePoses::update(const std::vector<MovedKeyframe>& moved,
                                      KeyframeStore& keyframes) {
  KeyframeMotions motions;
  for (const MovedKeyframe& keyframe : moved) {
    const auto known = keyframes.by_stamp().find(keyframe.stamp_ns);
    if (known == keyframes.by_stamp().end() || !is_rigid(keyframe.T_camera_world)) continue;
    const Tensor motion = update_pose(known->second, keyframe.T_camera_world, keyframes);
    if (!motion.defined()) continue;
    move_followers(known->second, motion, keyframes);
    motions[static_cast<std::int64_t>(known->second)] = motion;
  }
  return motions;
}

// Motion of the world around a keyframe with a new odometry pose; undefined when negligible. For a
// keyframe registered to the map, a small change is absorbed by the map-odometry transform.
Tensor KeyframePoses::update_pose(std::size_t i, const Tensor& T_camera_odometry,
                                  KeyframeStore& keyframes) {
  const Tensor pose = map_odom_.pose_in_map(i, T_camera_odometry);
  const Tensor before = keyframes[i].T_camera_world;
  const double moved = motion_size(pose.mm(rigid_inverse(before)));
  if (map_odom_.is_registered(i) && moved < kRegisteredTolerance_m) {
    map_odom_.set_registered(i, T_camera_odometry, before);
    return {};
  }
  if (moved < kMinMotion) return {};
  keyframes.set_pose(i, pose);
  return rigid_inverse(pose).mm(before);
}

void KeyframePoses::move_followers(std::size_t leader, const Tensor& motion,
                                   KeyframeStore& keyframes) {
  const auto found = followers_.find(leader);
  if (found == followers_.end()) return;
  for (const std::size_t i : found->second) move_keyframe(keyframes, i, motion);
}

// A held-out image moves with the preceding keyframe.
KeyframeMotions KeyframePoses::correct(const std::vector<LoopCorrection>& loop_corrections,
                                       KeyframeStore& keyframes) {
  KeyframeMotions motions;
  std::map<std::int64_t, Tensor> by_time;
  for (const LoopCorrection& correction : loop_corrections) {
    if (!is_rigid(correction.motion)) return motions;
    by_time[correction.stamp_ns] = correction.motion;
  }
  if (loop_corrections.empty()) return motions;
  const LoopCorrection& last = loop_corrections.back();
  Tensor motion;
  for (const auto& [stamp, i] : keyframes.by_stamp()) {
    if (stamp > last.stamp_ns) {
      motion = last.motion;
    } else if (!keyframes[i].held_out) {
      const auto listed = by_time.find(stamp);
      motion = listed == by_time.end() ? Tensor() : listed->second;
    }
    if (!motion.defined()) continue;
    map_odom_.apply_correction(i, motion);
    move_keyframe(keyframes, i, motion);
    if (!keyframes[i].held_out) motions[static_cast<std::int64_t>(i)] = motion;
  }
  map_odom_.correct_current(last.motion);
  return motions;
}

void KeyframePoses::register_newest(const Tensor& T_camera_map, KeyframeStore& keyframes) {
  const std::size_t newest = keyframes.size() - 1;
  const Keyframe& keyframe = keyframes[newest];
  map_odom_.register_newest(
      keyframe.stamp_ns, map_odom_.pose_in_odometry(newest, keyframe.T_camera_world), T_camera_map);
  keyframes.set_pose(newest, T_camera_map);
}

void KeyframePoses::change_scale(const gaussians::ScaleChange& change, KeyframeStore& keyframes) {
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    keyframes.set_pose(i, rescaled_pose(keyframes[i].T_camera_world, change));
  }
  map_odom_.change_scale(change);
}

Tensor KeyframePoses::relative_pose(std::size_t i, std::size_t reference,
                                    const KeyframeStore& keyframes) const {
  return map_odom_.pose_in_map(reference,
                               map_odom_.pose_in_odometry(i, keyframes[i].T_camera_world));
}

void KeyframePoses::save(torch::serialize::OutputArchive& archive) const {
  torch::serialize::OutputArchive map_odom;
  map_odom_.save(map_odom);
  archive.write("map_odom", map_odom);
}

void KeyframePoses::load(torch::serialize::InputArchive& archive) {
  torch::serialize::InputArchive map_odom;
  archive.read("map_odom", map_odom);
  map_odom_.load(map_odom);
}

}  // namespace apvi::mapping
