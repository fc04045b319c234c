// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "gaussians/model/similarity.hpp"
#include "mapping/alignment/image_alignment.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// The camera pose [4,4] float64 after the unit of length of its world changed.
torch::Tensor rescaled_pose(const torch::Tensor& T_camera_world,
                            const gaussians::ScaleChange& change);

/// Transform between the map and odometry frames (REP 105), one per keyframe. It is updated when a
/// keyframe is registered to previously mapped areas, so that revisited surfaces are not mapped
/// twice in spite of odometry drift.
///
/// Poses are T_camera_world [4,4] float64 with the odometry or map frame as world. Keyframes are
/// indexed as in KeyframeStore.
class MapOdomTransform {
 public:
  /// `drift_per_second`: standard deviation of odometry drift per second.
  explicit MapOdomTransform(const PoseSigmas& drift_per_second)
      : drift_per_second_(drift_per_second) {}

  /// Adds a keyframe with the current transform.
  void add();

  /// Converts an odometry pose to the map frame with the transform of keyframe `i`, and back.
  torch::Tensor pose_in_map(std::size_t i, const torch::Tensor& T_camera_odometry) const;
  torch::Tensor pose_in_odometry(std::size_t i, const torch::Tensor& T_camera_map) const;
  /// Converts points [n,3] float64 from odometry to map with the current transform.
  torch::Tensor points_in_map(const torch::Tensor& points) const;

  /// Expected drift at `stamp_ns` since the last registration.
  PoseSigmas sigmas(std::int64_t stamp_ns) const;
  /// Registers the newest keyframe to the map and updates the current transform.
  void register_newest(std::int64_t stamp_ns, const torch::Tensor& T_camera_odometry,
                       const torch::Tensor& T_camera_map);
  /// Updates the transform of a registered keyframe whose odometry pose has changed.
  void set_registered(std::size_t i, const torch::Tensor& T_camera_odometry,
                      const torch::Tensor& T_camera_map);
  /// Applies a loop closure motion of the map to keyframe `i`, or to the current transform.
  void apply_correction(std::size_t i, const torch::Tensor& motion);
  void correct_current(const torch::Tensor& motion);
  /// Changes the unit of length of both frames.
  void change_scale(const gaussians::ScaleChange& change);
  /// Whether keyframe `i` is registered to the map.
  bool is_registered(std::size_t i) const { return keyframes_.at(i).registered; }

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  struct Entry {
    torch::Tensor T_odometry_map;
    bool registered = false;
  };
  PoseSigmas drift_per_second_;
  torch::Tensor current_ = torch::eye(4, torch::kFloat64);  ///< T_odometry_map
  std::vector<Entry> keyframes_;
  std::int64_t last_registered_ns_ = 0;  ///< 0: never
};

}  // namespace apvi::mapping
