// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/loop_closure/options.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "loop_closure/loop_closer.hpp"
#include "loop_closure/place_map.hpp"
#include "loop_closure/pose_graph.hpp"

namespace apvi::loop_closure {

/// A finished dive, as it left its places and its smoothed trajectory.
struct Session {
  PlaceMap places;        ///< in order of time
  Trajectory trajectory;  ///< of the body, smoothed, in the frame of the places, z up; not empty
  CameraModel camera;     ///< of the images of the places
  double pixel_sigma = PlaceOptions{}.pixel_sigma;
  /// Of the smoothed trajectory, what its own loops have left.
  DriftVariance drift_per_s = *closer_options(LoopOptions{}).drift_per_s;
};

/// The nodes of a session in a pose graph of several, and where they lie in the joint frame:
/// T_joint_x = correction(stamp).transform() * T_session_x for every pose at that stamp.
class SessionPath {
 public:
  /// Nodes are poses at even times, and the last one; about `max_nodes` at most, by a longer step.
  /// Throws InputError for a trajectory without poses.
  SessionPath(const Trajectory& trajectory, double node_step_s, std::size_t max_nodes);

  std::size_t size() const { return nodes_.size(); }
  Stamp stamp(std::size_t node) const { return nodes_[node].stamp; }
  /// In the frame of the session.
  const SE3& pose(std::size_t node) const { return nodes_[node].T_world_body; }
  /// The node nearest in time.
  std::size_t node_at(Stamp stamp) const;
  /// The node nearest to a position in the frame of the session.
  std::size_t node_near(const Eigen::Vector3d& position) const;

  /// Moves the session as a whole.
  void place(const DriftCorrection& correction);
  /// One per node.
  std::vector<DriftCorrection>& corrections() { return corrections_; }
  const std::vector<DriftCorrection>& corrections() const { return corrections_; }
  /// Interpolated between nodes, that of the first or last one beyond them.
  DriftCorrection correction(Stamp stamp) const;
  /// A trajectory of the session in the joint frame.
  Trajectory corrected(const Trajectory& trajectory) const;

 private:
  std::vector<StampedPose> nodes_;
  std::vector<DriftCorrection> corrections_;
};

/// The edges of a session between its own nodes: from node to node by its trajectory, and the loops
/// that its places close, so that another session does not pull its lines apart. `gate`: largest
/// squared Mahalanobis distance of a loop from the trajectory.
std::vector<Edge> own_edges(const Session& session, const SessionPath& path, double gate);

}  // namespace apvi::loop_closure
