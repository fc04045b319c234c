// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <deque>
#include <optional>
#include <vector>

#include "loop_closure/known_map.hpp"

namespace apvi::loop_closure {

/// A keyframe of this dive in the known map.
struct KnownKeyframe {
  std::size_t keyframe = 0;
  MapFix fix;
};

/// Where the known map lies, as several images agree.
struct Relocalization {
  LevelPose pose;                     ///< by all of them
  std::vector<KnownKeyframe> images;  ///< in order of time
  std::size_t points = 0;             ///< of the map, apart from each other
};

/// Decides from the fixes of successive images where the known map lies. Precision over recall: it
/// must be the same place by the odometry between several images, with enough different points,
/// for a fair part of the images since the first of them, and no other place may be nearly as well
/// supported, as one that looks alike is.
class Relocalizer {
 public:
  explicit Relocalizer(double sigma) : sigma_(sigma) {}

  /// The fixes of the next image, none when it was not recognized. A result as soon as there is
  /// one.
  std::optional<Relocalization> add(std::size_t keyframe, std::vector<MapFix> fixes);

 private:
  struct Image {
    std::size_t keyframe = 0;
    std::vector<MapFix> fixes;
  };
  struct Hypothesis {
    std::vector<KnownKeyframe> images;
    std::size_t points = 0;
  };

  Hypothesis supporters(const MapFix& fix) const;
  std::size_t rival_points(const SE3& T_world_map, const Eigen::Vector3d& camera) const;
  std::size_t images_since(std::size_t keyframe) const;
  std::optional<Relocalization> joined(const Hypothesis& hypothesis) const;

  double sigma_;  ///< of a ray on the plane z = 1
  std::deque<Image> images_;
};

}  // namespace apvi::loop_closure
