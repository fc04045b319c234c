// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "apvi/sensors/camera_model.hpp"
#include "loop_closure/level_pose.hpp"
#include "loop_closure/place.hpp"
#include "loop_closure/place_index.hpp"
#include "loop_closure/place_map.hpp"

namespace apvi::loop_closure {

/// The pose of a known map by one image.
struct MapFix {
  LevelPose pose;
  LevelView view;            ///< the points that fit
  std::size_t features = 0;  ///< different features of the image among them
};

/// The map of an earlier dive, in which images are found. Features are matched with those of
/// several places, and their points are put together in one RANSAC, so few are needed of each. With
/// a pose, features are matched again near where the points should be seen, which finds more.
class KnownMap {
 public:
  KnownMap(PlaceMap map, const CameraModel& camera, double pixel_sigma);

  std::size_t places() const { return map_.places.size(); }
  /// Standard deviation of a ray on the plane z = 1.
  double sigma() const { return sigma_; }
  /// Without a prior pose: the best fix, and one that contradicts it, if there is such. Empty when
  /// the image is not recognized.
  std::vector<MapFix> find(const Place& place, const SE3& T_world_camera) const;
  /// Near a predicted pose of the map.
  std::optional<MapFix> find_near(const Place& place, const SE3& T_world_camera,
                                  const SE3& T_world_map) const;

 private:
  std::vector<std::size_t> places_apart(const std::vector<std::size_t>& ranking,
                                        const SE3& T_map_camera) const;
  std::vector<std::size_t> visible_places(const SE3& T_map_camera) const;
  LevelView match(const Place& place, const SE3& T_world_camera,
                  const std::vector<std::size_t>& places) const;
  LevelView match_near(const Place& place, const SE3& T_world_camera, const SE3& T_world_map) const;
  std::optional<MapFix> fix(const LevelView& seen) const;

  PlaceMap map_;
  std::vector<Place> places_;  ///< of the map, as they are matched
  PlaceIndex index_;
  CameraModel camera_;
  double sigma_;  ///< of a ray on the plane z = 1
};

}  // namespace apvi::loop_closure
