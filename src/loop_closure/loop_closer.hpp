// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/loop_closure/options.hpp"
#include "loop_closure/place.hpp"
#include "loop_closure/pose_graph.hpp"

namespace apvi::loop_closure {

/// Correction of the pose of a keyframe.
struct KeyframeCorrection {
  Stamp stamp;
  SE3 T_after_before;  ///< left-multiplies the last reported camera pose
};

/// Detects loop closures and corrects the path by a pose graph. Odometry keeps its own world frame;
/// the results are corrections of keyframe poses. Candidates are places that should be visible from
/// the corrected odometry pose; a bag-of-words index is not needed, as with a DVL and IMU the drift
/// stays smaller than the view.
class LoopCloser {
 public:
  LoopCloser(const LoopOptions& options, const Pinhole& camera);

  /// Adds a keyframe: its 8-bit gray image and the camera pose of the odometry, in order of time.
  /// Returns the changed keyframe corrections in order of time, the last one being that of this
  /// keyframe; usually empty. An empty image is not searched for loops.
  std::vector<KeyframeCorrection> add(Stamp stamp, const cv::Mat& gray, const SE3& T_world_camera);
  /// Optimizes and returns corrections, as `add` does, for loops found since the last optimization;
  /// call it at the end of a run.
  std::vector<KeyframeCorrection> flush();
  /// Updates the odometry pose of a keyframe. Ignored if the keyframe is unknown.
  void update_pose(Stamp stamp, const SE3& T_world_camera);

  /// Number of accepted loop closures.
  std::size_t closures() const { return loops_.size(); }

 private:
  struct Keyframe {
    Stamp stamp;
    SE3 T_world_camera;  ///< from odometry
    DriftCorrection reported;
  };
  struct StoredPlace {
    std::size_t keyframe = 0;
    Place place;
  };
  /// Relative pose of two keyframes.
  struct Loop {
    std::size_t from = 0;
    std::size_t to = 0;
    SE3 T_from_to;
  };
  struct Candidate {
    const StoredPlace* stored = nullptr;
    double visible_fraction = 0.0;
  };
  void add_keyframe(Stamp stamp, const SE3& T_world_camera);
  bool is_new_place() const;
  Place make_place(const cv::Mat& gray);
  void store_place(Place place);
  double age_s(std::size_t keyframe) const;
  std::size_t nearest_node(std::size_t keyframe) const;
  DriftCorrection correction(std::size_t keyframe) const;
  SE3 corrected_pose(std::size_t keyframe) const;
  double visible_fraction(const StoredPlace& stored, const SE3& T_camera_world) const;
  std::vector<Candidate> candidates() const;
  bool is_plausible(const Loop& loop) const;
  bool detect_loops(const Place& place);
  bool is_optimization_due() const;
  std::vector<SE3> node_poses() const;
  Edge edge(const Loop& loop) const;
  Edge edge_to_next(std::size_t node) const;
  void optimize_graph();
  std::vector<KeyframeCorrection> keyframe_corrections();

  LoopOptions options_;
  Pinhole camera_;
  std::vector<Keyframe> keyframes_;
  std::map<Stamp, std::size_t> by_stamp_;
  std::vector<std::size_t> nodes_;  ///< pose-graph nodes: indices of keyframes kNodeStep_s apart
  std::vector<DriftCorrection> corrections_;  ///< of the nodes
  std::vector<Loop> loops_;
  std::vector<StoredPlace> places_;
  bool has_new_loops_ = false;  ///< a loop has been found since the last optimization
  std::optional<Stamp> last_optimization_;
};

}  // namespace apvi::loop_closure
