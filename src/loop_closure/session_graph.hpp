// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "loop_closure/session_path.hpp"

namespace apvi::loop_closure {

/// Relative pose of nodes of two sessions; the nodes are counted by session.
struct CrossEdge {
  std::size_t from_session = 0;
  std::size_t to_session = 0;
  Edge edge;
};

/// One pose graph over the nodes of several sessions, with four degrees of freedom per node. It
/// contains the sessions that have been placed. The first node of the first one is fixed.
class SessionGraph {
 public:
  struct Options {
    double node_step_s = 2.0;      ///< time between nodes
    std::size_t max_nodes = 2000;  ///< of a session
    double gate = SmoothingOptions{}.gate;
  };

  /// Throws InputError for a trajectory without poses.
  SessionGraph(const std::vector<Session>& sessions, const Options& options);

  /// Adds a session to the graph, as a whole at a pose of the joint frame.
  void place(std::size_t session, const DriftCorrection& T_joint_session);
  /// Takes it and its cross edges out again.
  void remove(std::size_t session);
  bool is_placed(std::size_t session) const;
  /// In the order in which they were placed.
  const std::vector<std::size_t>& placed() const { return placed_; }

  /// Between placed sessions.
  void add(const CrossEdge& edge) { cross_.push_back(edge); }
  const std::vector<CrossEdge>& cross_edges() const { return cross_; }
  /// Squared Mahalanobis distance of an edge from the graph, see EdgeCheck.
  double squared_distance(const CrossEdge& edge) const;
  void optimize();

  const SessionPath& path(std::size_t session) const { return paths_[session]; }
  /// Distance from where an edge puts its second node to where that is [m]: as the graph is, or
  /// with every session as a whole where it was placed.
  double distance_m(const CrossEdge& edge) const;
  double distance_as_placed_m(const CrossEdge& edge) const;

 private:
  std::size_t first_node(std::size_t session) const;
  Edge in_graph(const CrossEdge& edge) const;
  PoseGraph graph() const;
  std::vector<DriftCorrection> corrections() const;

  std::vector<SessionPath> paths_;
  std::vector<std::vector<Edge>> own_edges_;  ///< by session
  std::vector<DriftCorrection> as_placed_;    ///< by session
  std::vector<std::size_t> placed_;
  std::vector<CrossEdge> cross_;
};

}  // namespace apvi::loop_closure
