// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <limits>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/loop_closure/options.hpp"
#include "loop_closure/bundle_adjustment.hpp"
#include "loop_closure/correction_log.hpp"
#include "loop_closure/keyframe_graph.hpp"
#include "loop_closure/known_map.hpp"
#include "loop_closure/map_anchors.hpp"
#include "loop_closure/own_map_search.hpp"
#include "loop_closure/place_map.hpp"
#include "loop_closure/place_store.hpp"
#include "loop_closure/view_shifts.hpp"

namespace apvi::loop_closure {

/// What the map and the trajectory ask of a `LoopCloser`.
struct CloserOptions {
  PlaceOptions places;
  KeyframeGraphOptions graph;
  /// Largest squared Mahalanobis distance of a loop from the graph.
  double gate = std::numeric_limits<double>::infinity();
  /// Error in sigmas that a loop must have to cause an optimization.
  double min_news_sigmas = 0.0;
  /// Factor on the sigmas of odometry in the drift of the keyframes.
  double drift_factor = 1.0;
  CameraPrior camera_prior = {};  ///< of the bundle adjustment
  /// Whether all poses are adjusted to the images at the end of a run.
  bool adjusts_bundle = false;
  /// Whether keyframe corrections are listed whenever they change.
  bool lists_corrections = false;
  /// Drift of odometry that does not report its own.
  std::optional<DriftVariance> drift_per_s = std::nullopt;
  /// The map of an earlier dive to be found in, if any.
  std::shared_ptr<const KnownMap> known_map = nullptr;
  /// Of the images, see CameraCalibration.
  cv::Mat mask = {};
};

/// For the map: corrections are rare, as each one changes the map.
CloserOptions closer_options(const LoopOptions& options);
/// For the trajectory: every loop counts, and it must agree with the graph.
CloserOptions closer_options(const SmoothingOptions& options);

/// Detects loop closures and corrects the path by a pose graph. Odometry keeps its own world frame;
/// the results are corrections of keyframe poses.
class LoopCloser {
 public:
  LoopCloser(const CloserOptions& options, const CameraModel& camera);

  /// Adds a keyframe and its 8-bit gray image, in order of time. An empty image is not searched for
  /// loops. True if the corrections have changed.
  bool add(Keyframe keyframe, const cv::Mat& gray);
  /// Optimizes with the loops found since the last optimization. True if the corrections have
  /// changed.
  bool flush();
  /// At the end of a run: `flush`, in a long one with every node and loop. True if the corrections
  /// have changed.
  bool finish();
  /// The bundle adjustment, after `finish`, if the options ask for it. True if the corrections have
  /// changed.
  bool adjust(const std::function<void(int iteration)>& progress = {});
  /// Updates the odometry pose of a keyframe. Ignored if the keyframe is unknown.
  void update_pose(Stamp stamp, const SE3& T_world_camera) {
    graph_.update_pose(stamp, T_world_camera);
  }

  /// The corrections of keyframes that have changed since the last call; the last one is that of
  /// the newest keyframe. The corrected frame is that of the known map once it has been found.
  KeyframeCorrections changed_corrections();
  const KeyframeGraph& graph() const { return graph_; }
  /// Of the camera, by the graph and, at the end of a run, by the bundle adjustment.
  SE3 corrected_pose(std::size_t keyframe) const {
    return shifts_.moved(graph_, keyframe, graph_.corrected_pose(keyframe));
  }
  /// From odometry to the corrected frame, which is that of the known map once it has been found,
  /// by the newest pose of the body.
  SE3 newest_correction() const;
  /// By which the pose of the body follows from the corrected one of the camera.
  SE3 T_body_camera(std::size_t keyframe) const {
    return adjusted_ ? adjusted_->T_body_camera : graph_[keyframe].T_body_camera;
  }
  /// The camera by the bundle adjustment; nullopt without one.
  const std::optional<BundleCamera>& adjusted_camera() const { return adjusted_; }
  /// What a later dive needs to be found here.
  PlaceMap place_map() const;
  /// Nothing without a known map.
  const MapAnchors* anchors() const { return anchors_ ? &*anchors_ : nullptr; }
  /// Breaks of the path, and those after which it was found again among the places before.
  std::size_t breaks() const { return breaks_; }
  std::size_t reconnections() const { return reconnections_; }
  /// Whether the newest keyframe was searched for loops, as a new place, or for a map.
  bool searched() const { return searched_; }
  /// Number of accepted loop closures.
  std::size_t closures() const { return closures_; }
  /// The keyframes that loop closures join, in the order of their acceptance, from number `first`.
  std::vector<ClosedLoop> loops(std::size_t first = 0) const;
  /// Number of loop closures that images support and the graph contradicts.
  std::size_t rejected() const { return rejected_; }

 private:
  SE3 correction(std::size_t keyframe) const;
  bool is_plausible(const Loop& loop) const;
  struct Found {
    Loop loop;
    double news = 0.0;  ///< see EdgeCheck
  };

  std::optional<Found> accepted(const Loop& loop) const;
  std::optional<Found> find_loop(const PlaceStore::Stored& stored, const Place& place);
  void detect_loops(const Place& place);
  void anchor_to_map(const Place& place);
  void begin_search();
  void reconnect(const Place& place);
  void search(const cv::Mat& gray, bool new_place);
  bool is_optimization_due() const;

  CloserOptions options_;
  KeyframeGraph graph_;
  PlaceStore places_;
  CameraModel camera_;
  std::optional<MapAnchors> anchors_;
  std::optional<OwnMapSearch> search_;  ///< since a break of the path, until it is found again
  std::vector<SE3> reported_;           ///< by keyframe, from odometry to the corrected frame
  ViewShifts shifts_;
  std::optional<BundleCamera> adjusted_;
  std::size_t closures_ = 0;
  std::size_t rejected_ = 0;
  std::size_t breaks_ = 0;
  std::size_t reconnections_ = 0;
  bool searched_ = false;
  double news_ = 0.0;       ///< of the loops and anchors since the last optimization
  bool was_found_ = false;  ///< by the newest keyframe, in the known map or after a break
  std::optional<Stamp> last_optimization_;
};

}  // namespace apvi::loop_closure
