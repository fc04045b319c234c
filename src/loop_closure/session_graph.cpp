// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/session_graph.hpp"

#include <algorithm>

namespace apvi::loop_closure {
namespace {

double distance_between(const SE3& from, const SE3& T_from_to, const SE3& to) {
  return (from * T_from_to.translation - to.translation).norm();
}

}  // namespace

SessionGraph::SessionGraph(const std::vector<Session>& sessions, const Options& options)
    : as_placed_(sessions.size()) {
  for (const Session& session : sessions) {
    const SessionPath& path =
        paths_.emplace_back(session.trajectory, options.node_step_s, options.max_nodes);
    own_edges_.push_back(own_edges(session, path, options.gate));
  }
}

void SessionGraph::place(std::size_t session, const DriftCorrection& T_joint_session) {
  placed_.push_back(session);
  as_placed_[session] = T_joint_session;
  paths_[session].place(T_joint_session);
}

void SessionGraph::remove(std::size_t session) {
  std::erase(placed_, session);
  std::erase_if(cross_, [session](const CrossEdge& edge) {
    return edge.from_session == session || edge.to_session == session;
  });
  paths_[session].place({});
}

bool SessionGraph::is_placed(std::size_t session) const {
  return std::ranges::find(placed_, session) != placed_.end();
}

std::size_t SessionGraph::first_node(std::size_t session) const {
  std::size_t first = 0;
  for (const std::size_t other : placed_) {
    if (other == session) break;
    first += paths_[other].size();
  }
  return first;
}

Edge SessionGraph::in_graph(const CrossEdge& edge) const {
  Edge joint = edge.edge;
  joint.from += first_node(edge.from_session);
  joint.to += first_node(edge.to_session);
  return joint;
}

PoseGraph SessionGraph::graph() const {
  PoseGraph graph;
  for (const std::size_t session : placed_) {
    for (const Edge& edge : own_edges_[session]) {
      graph.edges.push_back(in_graph({session, session, edge}));
    }
    const SessionPath& path = paths_[session];
    for (std::size_t node = 0; node < path.size(); ++node) {
      graph.odometry.push_back(path.pose(node));
    }
  }
  for (const CrossEdge& edge : cross_) graph.edges.push_back(in_graph(edge));
  return graph;
}

std::vector<DriftCorrection> SessionGraph::corrections() const {
  std::vector<DriftCorrection> all;
  for (const std::size_t session : placed_) {
    const std::vector<DriftCorrection>& own = paths_[session].corrections();
    all.insert(all.end(), own.begin(), own.end());
  }
  return all;
}

double SessionGraph::squared_distance(const CrossEdge& edge) const {
  return LinearGraph(graph(), corrections()).check(in_graph(edge)).squared_distance;
}

void SessionGraph::optimize() {
  std::vector<DriftCorrection> all = corrections();
  loop_closure::optimize(graph(), all);
  auto next = all.begin();
  for (const std::size_t session : placed_) {
    std::vector<DriftCorrection>& own = paths_[session].corrections();
    const auto end = next + static_cast<std::ptrdiff_t>(own.size());
    std::copy(next, end, own.begin());
    next = end;
  }
}

double SessionGraph::distance_m(const CrossEdge& edge) const {
  const SessionPath& from = paths_[edge.from_session];
  const SessionPath& to = paths_[edge.to_session];
  const Edge& e = edge.edge;
  return distance_between(from.corrections()[e.from].transform() * from.pose(e.from), e.T_from_to,
                          to.corrections()[e.to].transform() * to.pose(e.to));
}

double SessionGraph::distance_as_placed_m(const CrossEdge& edge) const {
  const Edge& e = edge.edge;
  return distance_between(
      as_placed_[edge.from_session].transform() * paths_[edge.from_session].pose(e.from),
      e.T_from_to, as_placed_[edge.to_session].transform() * paths_[edge.to_session].pose(e.to));
}

}  // namespace apvi::loop_closure
