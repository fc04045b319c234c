// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <vector>

#include "apvi/core/constants.hpp"
#include "apvi/core/stamp.hpp"
#include "loop_closure/pose_graph.hpp"

namespace apvi::loop_closure {

/// Variance of the drift of odometry over a span, a random walk.
struct DriftVariance {
  double heading = 0.0;     ///< [rad²]
  double horizontal = 0.0;  ///< of each axis [m²]
  double vertical = 0.0;    ///< [m²]

  DriftVariance& operator+=(const DriftVariance& other);
  friend DriftVariance operator*(const DriftVariance& drift, double factor) {
    return {drift.heading * factor, drift.horizontal * factor, drift.vertical * factor};
  }
};

/// A keyframe as odometry sees it.
struct Keyframe {
  Stamp stamp;
  SE3 T_world_camera;
  SE3 T_body_camera = SE3::identity();  ///< by which the pose of the camera was computed
  DriftVariance drift;                  ///< since the keyframe before
  /// Standard deviation of the absolute height [m]; nothing if it is not measured.
  std::optional<double> height_sigma_m;
};

/// Of the relative pose of two places by their images.
inline constexpr EdgeSigmas kLoopSigmas{
    .heading_rad = 0.05 * kRadiansPerDegree, .horizontal_m = 0.007, .vertical_m = 0.007};

/// Relative pose of the cameras of two keyframes, seen in their images.
struct Loop {
  std::size_t from = 0;
  std::size_t to = 0;
  SE3 T_from_to;
  EdgeSigmas sigmas = kLoopSigmas;
};

/// A keyframe seen in the map of an earlier dive.
struct Anchor {
  std::size_t keyframe = 0;
  SE3 T_known_camera;
  EdgeSigmas sigmas;
};

struct KeyframeGraphOptions {
  double node_step_s = 4.0;  ///< time between nodes
  std::size_t max_nodes = std::numeric_limits<std::size_t>::max();
};

/// The pose graph of a dive: nodes are keyframes at even times, and corrections are interpolated
/// between them, so that the error of a single loop does not distort the path between neighboring
/// keyframes. Beyond `max_nodes` every second node is dropped, and of the loops between two nodes
/// one is kept, so the work is bounded; `refine` solves for all of them in the end. A loop is in
/// the graph from the next `optimize` on: the covariance that others are checked with would be too
/// small for poses that have not been moved by it. Loops are kept between keyframes and expressed
/// between their nearest nodes. A known map is one more node, to which anchors are edges. The
/// keyframes on either side of a break are nodes, so that no correction is interpolated over it.
class KeyframeGraph {
 public:
  explicit KeyframeGraph(const KeyframeGraphOptions& options)
      : options_(options), node_step_s_(options.node_step_s) {}

  /// In order of time.
  void add(const Keyframe& keyframe);
  /// Updates the odometry pose of a keyframe. Ignored if the keyframe is unknown.
  void update_pose(Stamp stamp, const SE3& T_world_camera);
  void add(const Loop& loop);
  /// The map of an earlier dive, in the corrected frame of this one.
  void add_known_map(const SE3& T_world_known) {
    T_world_known_ = T_world_known;
    linear_.reset();
  }
  /// After `add_known_map`.
  void add(const Anchor& anchor);

  std::size_t size() const { return keyframes_.size(); }
  const Keyframe& operator[](std::size_t keyframe) const { return keyframes_[keyframe]; }
  std::size_t nodes() const { return nodes_.size(); }
  /// Whether the path is broken before a keyframe: its drift since the keyframe before is so large
  /// that no image of an earlier place could be predicted.
  bool is_break(std::size_t keyframe) const;
  std::size_t newest() const { return keyframes_.size() - 1; }
  /// Time from a keyframe to the newest one [s].
  double age_s(std::size_t keyframe) const;
  /// Length of the way from one keyframe to a later one [m].
  double path_m(std::size_t from, std::size_t to) const { return path_m_[to] - path_m_[from]; }
  DriftCorrection correction(std::size_t keyframe) const;
  /// Gives every keyframe from a break on the same correction, a heading and a translation.
  void place_since(std::size_t first, const SE3& T_corrected_odometry);
  SE3 corrected_pose(std::size_t keyframe) const;
  /// Motion of the camera from one keyframe to a later one by odometry, and how uncertain it is.
  SE3 motion(std::size_t from, std::size_t to) const;
  EdgeSigmas drift(std::size_t from, std::size_t to) const { return with_drift({}, from, to); }
  const std::vector<Anchor>& anchors() const { return anchors_; }
  bool has_known_map() const { return T_world_known_.has_value(); }
  /// Where the known map lies in the corrected frame; identity without one.
  SE3 T_world_known() const;

  /// Error of a loop in sigmas.
  double residual_norm(const Loop& loop) const;
  /// Every loop that was added.
  const std::vector<Loop>& loops() const { return all_loops_; }
  std::size_t edges() const { return loops_.size() + anchors_.size(); }
  /// How a loop agrees with the graph as it was optimized last. Keyframes that are newer than that
  /// are a few seconds of odometry away from its newest node.
  EdgeCheck check(const Loop& loop) const;
  EdgeCheck check(const Anchor& anchor) const;
  void optimize();
  /// Optimizes with every node and loop that has been left out for the bound of work, or was added
  /// since `optimize`. False if there is none.
  bool refine();

 private:
  std::size_t node_before(std::size_t keyframe) const;
  std::size_t nearest_node(std::size_t keyframe) const;
  /// Among the first `count` nodes.
  std::size_t nearest_node(std::size_t keyframe, std::size_t count) const;
  bool is_thinned() const { return node_step_s_ > options_.node_step_s; }
  bool is_beside_break(std::size_t keyframe) const;
  void push_node(std::size_t keyframe);
  void thin_out();
  void merge_loops();
  void take_pending();
  const LinearGraph& linear() const;
  /// Sigmas with the drift between two keyframes added.
  EdgeSigmas with_drift(const EdgeSigmas& sigmas, std::size_t a, std::size_t b) const;
  /// Between the first `count` nodes.
  Edge edge(const Loop& loop, std::size_t count) const;
  Edge edge(const Anchor& anchor, std::size_t count) const;
  Edge edge_to_next(std::size_t node) const;
  std::vector<SE3> node_poses() const;
  std::vector<DriftCorrection> node_corrections() const;
  PoseGraph graph() const;

  KeyframeGraphOptions options_;
  double node_step_s_;  ///< at present
  std::vector<Keyframe> keyframes_;
  std::vector<double> path_m_;        ///< by keyframe, since the first one
  std::vector<DriftVariance> drift_;  ///< by keyframe, since the first one
  std::map<Stamp, std::size_t> by_stamp_;
  std::vector<std::size_t> nodes_;            ///< indices of keyframes
  std::vector<DriftCorrection> corrections_;  ///< of the nodes
  std::vector<Loop> all_loops_;
  std::vector<Loop> loops_;           ///< those of the present nodes that `optimize` has used
  std::vector<Loop> pending_;         ///< since then
  std::optional<SE3> T_world_known_;  ///< before its correction
  DriftCorrection known_correction_;
  std::vector<Anchor> anchors_;
  mutable std::optional<LinearGraph> linear_;  ///< for `check`
  mutable std::size_t linear_nodes_ = 0;       ///< number of its nodes, the first ones
};

}  // namespace apvi::loop_closure
