// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

#include "mapping/alignment/map_odom_transform.hpp"
#include "mapping/keyframes/keyframe_store.hpp"

namespace apvi::mapping {

/// Updated pose of an existing keyframe.
struct MovedKeyframe {
  std::int64_t stamp_ns = 0;
  torch::Tensor T_camera_world;  ///< [4,4] float64
};

/// A loop closure correction: the rigid motion of the world around one keyframe.
struct LoopCorrection {
  std::int64_t stamp_ns = 0;
  torch::Tensor motion;  ///< [4,4] float64, rigid, relative to the current map
};

/// Rigid motions [4,4] float64 of the world around training keyframes, by their index.
using KeyframeMotions = std::map<std::int64_t, torch::Tensor>;

/// Keeps the poses of a KeyframeStore in the map frame, given poses in the odometry frame and loop
/// corrections. Held-out images are not in the odometry window; they move with their leading
/// keyframe.
class KeyframePoses {
 public:
  /// `drift_per_second`: standard deviation of odometry drift per second.
  explicit KeyframePoses(const PoseSigmas& drift_per_second) : map_odom_(drift_per_second) {}

  /// Adds a keyframe with its odometry pose to the store, in which it has its pose in the map.
  void add(const Keyframe& keyframe, KeyframeStore& keyframes);
  /// From now on, held-out image `held_out` moves with keyframe `leader`.
  void follow(std::size_t leader, std::size_t held_out) { followers_[leader].push_back(held_out); }

  /// Applies changed odometry poses. Returns the motions; negligible ones are left out.
  KeyframeMotions update(const std::vector<MovedKeyframe>& moved, KeyframeStore& keyframes);
  /// Applies corrections in order of time; the last also applies to all later keyframes, and an
  /// invalid one invalidates all. Returns the motions.
  KeyframeMotions correct(const std::vector<LoopCorrection>& loop_corrections,
                          KeyframeStore& keyframes);
  /// Registers the newest keyframe at its pose in the map.
  void register_newest(const torch::Tensor& T_camera_map, KeyframeStore& keyframes);

  /// Changes the unit of length of all poses.
  void change_scale(const gaussians::ScaleChange& change, KeyframeStore& keyframes);

  /// Pose of keyframe `i` in the map that odometry implies relative to keyframe `reference`.
  torch::Tensor relative_pose(std::size_t i, std::size_t reference,
                              const KeyframeStore& keyframes) const;
  const MapOdomTransform& map_odom() const { return map_odom_; }

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  torch::Tensor update_pose(std::size_t i, const torch::Tensor& T_camera_odometry,
                            KeyframeStore& keyframes);
  void move_followers(std::size_t leader, const torch::Tensor& motion, KeyframeStore& keyframes);

  MapOdomTransform map_odom_;
  std::map<std::size_t, std::vector<std::size_t>>
      followers_;  ///< held-out images by leading keyframe
};

}  // namespace apvi::mapping
