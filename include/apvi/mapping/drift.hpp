// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "apvi/mapping/picture_alignment.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// How odometry has drifted against the map: where what it saw long ago is seen again, the map says
/// how far off it has come since. Keyframes stand in the map where it has them, so that what was
/// mapped is met again and not drawn a second time beside itself.
///
/// Poses are T_camera_world [4,4] float64, the world odometry's or the map's. Keyframes are counted
/// as in KeyframeStore.
class Drift {
 public:
  /// How much is thought possible a second.
  explicit Drift(const PoseSigmas& each_second) : each_second_(each_second) {}

  /// A keyframe comes in: it has what is known now.
  void add();

  /// A pose of odometry's in the map, drifted as at keyframe `i`; and back.
  torch::Tensor in_map(std::size_t i, const torch::Tensor& T_camera_odometry) const;
  torch::Tensor in_odometry(std::size_t i, const torch::Tensor& T_camera_map) const;
  /// Points [n,3] float64 of odometry's as it is now, in the map.
  torch::Tensor points_in_map(const torch::Tensor& points) const;

  /// How far off it may have come by then since the map last said.
  PoseSigmas sigmas(std::int64_t stamp_ns) const;
  /// The map says where the newest keyframe stands; so do those that come after it.
  void found_newest(std::int64_t stamp_ns, const torch::Tensor& T_camera_odometry,
                    const torch::Tensor& T_camera_map);
  /// Odometry has changed its mind about a keyframe that the map has placed.
  void found(std::size_t i, const torch::Tensor& T_camera_odometry,
             const torch::Tensor& T_camera_map);
  /// The map is moved about a keyframe; and about those that come.
  void relocate(std::size_t i, const torch::Tensor& motion);
  void relocate_next(const torch::Tensor& motion);
  /// Whether the map has placed it.
  bool is_found(std::size_t i) const { return keyframes_.at(i).found; }

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  struct Entry {
    torch::Tensor T_odometry_map;
    bool found = false;
  };
  PoseSigmas each_second_;
  torch::Tensor now_ = torch::eye(4, torch::kFloat64);  ///< T_odometry_map
  std::vector<Entry> keyframes_;
  std::int64_t last_found_ns_ = 0;  ///< 0: never
};

}  // namespace apvi::mapping
