// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <deque>
#include <vector>

#include "apvi/loop_closure/options.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "loop_closure/keyframe_graph.hpp"
#include "loop_closure/place.hpp"

namespace apvi::loop_closure {

/// The places of a dive, at most `max_places`. When there are more, those stay that are evenly
/// spread in space, the oldest of each neighborhood, so that their number grows with the area that
/// has been seen, not with time (as in Johannsson et al., "Temporally scalable visual SLAM using a
/// reduced pose graph", 2013). Candidates for a loop are places that should be
/// visible from the corrected pose; a bag-of-words index is not needed, as with a DVL and IMU the
/// drift stays smaller than the view.
class PlaceStore {
 public:
  struct Stored {
    std::size_t keyframe = 0;
    Place place;
    std::size_t triangulated = 0;  ///< number of its points
    double reach_m = 0.0;          ///< distance of the farthest one
  };

  /// `mask`: see CameraCalibration.
  PlaceStore(const PlaceOptions& options, const CameraModel& camera, const cv::Mat& mask = {});

  /// Whether the newest keyframe is far enough from the last place that features have parallax.
  bool is_new_place(const KeyframeGraph& graph) const;
  /// The features of an image, none of them triangulated.
  Place features(const cv::Mat& gray) const;
  /// The place of the newest keyframe, triangulated with the last place, which gains points too.
  /// The oldest of the recent places gets better ones, from the widest baseline.
  Place describe(const KeyframeGraph& graph, const cv::Mat& gray);
  /// Places at least `min_age_s` old that the newest keyframe should see, among those of keyframe
  /// `first` and later ones; the first has the most features that should match.
  std::vector<const Stored*> candidates(const KeyframeGraph& graph, std::size_t first) const;
  /// Of the newest keyframe.
  void store(const KeyframeGraph& graph, Place place);
  /// The path is broken: the next place is triangulated with none before it.
  void end_path(const KeyframeGraph& graph);
  /// Whether there is a place since `end_path`, or the beginning.
  bool has_path() const { return !recent_.empty(); }
  std::vector<const Stored*> all() const;
  /// Standard deviation of a ray on the plane z = 1.
  double ray_sigma() const { return ray_sigma_; }

 private:
  struct Near {
    const Stored* stored = nullptr;
    SE3 T_now_then;
    double distance_m = 0.0;
  };

  std::vector<Near> nearest(const KeyframeGraph& graph, std::size_t first) const;
  void keep(const KeyframeGraph& graph, Stored stored);
  void thin_out(const KeyframeGraph& graph);

  PlaceOptions options_;
  CameraModel camera_;
  cv::Mat mask_;
  double ray_sigma_;
  std::vector<Stored> places_;
  std::deque<Stored> recent_;  ///< not yet in places_: their points still improve
  double spacing_m_ = 0.0;     ///< between places with the same view
};

}  // namespace apvi::loop_closure
