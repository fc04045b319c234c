// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "apvi/loop_closure/options.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "loop_closure/keyframe_graph.hpp"
#include "loop_closure/place.hpp"

namespace apvi::loop_closure {

/// The places of a dive, at most `max_places`. Candidates for a loop are places that should be
/// visible from the corrected pose; a bag-of-words index is not needed, as with a DVL and IMU the
/// drift stays smaller than the view.
class PlaceStore {
 public:
  struct Stored {
    std::size_t keyframe = 0;
    Place place;
  };

  PlaceStore(const PlaceOptions& options, const CameraModel& camera);

  /// Whether the newest keyframe is far enough from the last place that features have parallax.
  bool is_new_place(const KeyframeGraph& graph) const;
  /// The features of an image, none of them triangulated.
  Place features(const cv::Mat& gray) const;
  /// The place of the newest keyframe, triangulated with the last place, which gains points too.
  Place describe(const KeyframeGraph& graph, const cv::Mat& gray);
  /// Places at least `min_age_s` old that the newest keyframe should see, the best first.
  std::vector<const Stored*> candidates(const KeyframeGraph& graph) const;
  void store(std::size_t keyframe, Place place);
  const std::vector<Stored>& places() const { return places_; }
  /// Standard deviation of a ray on the plane z = 1.
  double ray_sigma() const { return ray_sigma_; }

 private:
  double visible_fraction(const Place& place, const SE3& T_now_then) const;

  PlaceOptions options_;
  CameraModel camera_;
  double ray_sigma_;
  std::vector<Stored> places_;
};

}  // namespace apvi::loop_closure
