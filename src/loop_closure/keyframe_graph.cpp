// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/keyframe_graph.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "apvi/geometry/so3.hpp"

namespace apvi::loop_closure {
namespace {

constexpr double kMinSigma = 1e-5;        // of odometry: the graph must stay solvable
constexpr double kMaxLinearAge_s = 10.0;  // time of odometry from a linearized graph
constexpr std::size_t kLoopsPerNode = 4;
constexpr std::size_t kAnchorsPerNode = 2;
// A break of the path: with more drift from one keyframe to the next, one sigma, earlier places are
// not where they are looked for.
constexpr double kBreak_m = 1.0;
constexpr double kBreakHeading = 20.0 * kRadiansPerDegree;

double sigma(double variance) {
  return std::max(kMinSigma, std::sqrt(std::max(0.0, variance)));
}

// Every second one; the first and the last stay.
template <typename T>
void drop_every_second(std::vector<T>& all) {
  if (all.size() < 3) return;
  std::size_t kept = 1;
  for (std::size_t i = 2; i + 1 < all.size(); i += 2) all[kept++] = all[i];
  all[kept++] = all.back();
  all.resize(kept);
}

}  // namespace

DriftVariance& DriftVariance::operator+=(const DriftVariance& other) {
  heading += other.heading;
  horizontal += other.horizontal;
  vertical += other.vertical;
  return *this;
}

void KeyframeGraph::add(const Keyframe& keyframe) {
  const std::size_t index = keyframes_.size();
  by_stamp_[keyframe.stamp] = index;
  const bool first = keyframes_.empty();
  DriftVariance drift = first ? DriftVariance{} : drift_.back();
  if (!first) drift += keyframe.drift;
  const double moved =
      first ? 0.0
            : (keyframe.T_world_camera.translation - keyframes_.back().T_world_camera.translation)
                  .norm();
  path_m_.push_back(first ? 0.0 : path_m_.back() + moved);
  drift_.push_back(drift);
  keyframes_.push_back(keyframe);
  const bool broken = is_break(index);
  if (broken && nodes_.back() + 1 < index) push_node(index - 1);
  if (first || broken || age_s(nodes_.back()) >= node_step_s_) push_node(index);
  if (nodes_.size() > options_.max_nodes) thin_out();
}

void KeyframeGraph::push_node(std::size_t keyframe) {
  nodes_.push_back(keyframe);
  corrections_.push_back(corrections_.empty() ? DriftCorrection{} : corrections_.back());
}

bool KeyframeGraph::is_break(std::size_t keyframe) const {
  const DriftVariance& drift = keyframes_[keyframe].drift;
  return keyframe > 0 &&
         (drift.horizontal > kBreak_m * kBreak_m || drift.heading > kBreakHeading * kBreakHeading);
}

bool KeyframeGraph::is_beside_break(std::size_t keyframe) const {
  return is_break(keyframe) || (keyframe < newest() && is_break(keyframe + 1));
}

// Every second node, those beside a break excepted.
void KeyframeGraph::thin_out() {
  linear_.reset();
  std::size_t kept = 0;
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    if (i % 2 != 0 && i + 1 < nodes_.size() && !is_beside_break(nodes_[i])) continue;
    nodes_[kept] = nodes_[i];
    corrections_[kept++] = corrections_[i];
  }
  nodes_.resize(kept);
  corrections_.resize(kept);
  node_step_s_ *= 2.0;
  merge_loops();
}

void KeyframeGraph::place_since(std::size_t first, const SE3& T_corrected_odometry) {
  linear_.reset();
  const DriftCorrection correction{.heading = so3::yaw(T_corrected_odometry.rotation),
                                   .translation = T_corrected_odometry.translation};
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    if (nodes_[i] >= first) corrections_[i] = correction;
  }
}

// Of the loops between the same two nodes the first stays: what errs in the points of a place errs
// in all of them.
void KeyframeGraph::merge_loops() {
  std::set<std::pair<std::size_t, std::size_t>> known;
  std::erase_if(loops_, [&](const Loop& loop) {
    return !known.emplace(nearest_node(loop.from), nearest_node(loop.to)).second;
  });
}

void KeyframeGraph::update_pose(Stamp stamp, const SE3& T_world_camera) {
  const auto known = by_stamp_.find(stamp);
  if (known != by_stamp_.end()) keyframes_[known->second].T_world_camera = T_world_camera;
}

void KeyframeGraph::add(const Loop& loop) {
  all_loops_.push_back(loop);
  pending_.push_back(loop);
}

// As with nodes, half of the loops of a long dive say as much.
void KeyframeGraph::take_pending() {
  loops_.insert(loops_.end(), pending_.begin(), pending_.end());
  pending_.clear();
  if (is_thinned()) merge_loops();
  while (loops_.size() / kLoopsPerNode > options_.max_nodes) drop_every_second(loops_);
}

void KeyframeGraph::add(const Anchor& anchor) {
  linear_.reset();
  anchors_.push_back(anchor);
  if (anchors_.size() / kAnchorsPerNode > options_.max_nodes) drop_every_second(anchors_);
}

double KeyframeGraph::age_s(std::size_t keyframe) const {
  return seconds_between(keyframes_[keyframe].stamp, keyframes_.back().stamp);
}

std::size_t KeyframeGraph::node_before(std::size_t keyframe) const {
  const auto next = std::upper_bound(nodes_.begin(), nodes_.end(), keyframe);
  return static_cast<std::size_t>(next - nodes_.begin()) - 1;
}

std::size_t KeyframeGraph::nearest_node(std::size_t keyframe) const {
  return nearest_node(keyframe, nodes_.size());
}

std::size_t KeyframeGraph::nearest_node(std::size_t keyframe, std::size_t count) const {
  const std::size_t before = node_before(keyframe);
  if (before + 1 >= count) return count - 1;
  const Stamp stamp = keyframes_[keyframe].stamp;
  const bool nearer = seconds_between(keyframes_[nodes_[before]].stamp, stamp) <
                      seconds_between(stamp, keyframes_[nodes_[before + 1]].stamp);
  return nearer ? before : before + 1;
}

DriftCorrection KeyframeGraph::correction(std::size_t keyframe) const {
  const std::size_t before = node_before(keyframe);
  const DriftCorrection& a = corrections_[before];
  if (before + 1 == nodes_.size()) return a;
  const DriftCorrection& b = corrections_[before + 1];
  const Stamp begin = keyframes_[nodes_[before]].stamp;
  const double part = seconds_between(begin, keyframes_[keyframe].stamp) /
                      seconds_between(begin, keyframes_[nodes_[before + 1]].stamp);
  return {.heading = a.heading + part * (b.heading - a.heading),
          .translation = a.translation + part * (b.translation - a.translation)};
}

SE3 KeyframeGraph::corrected_pose(std::size_t keyframe) const {
  return correction(keyframe).transform() * keyframes_[keyframe].T_world_camera;
}

SE3 KeyframeGraph::T_world_known() const {
  return T_world_known_ ? known_correction_.transform() * *T_world_known_ : SE3::identity();
}

EdgeSigmas KeyframeGraph::with_drift(const EdgeSigmas& sigmas, std::size_t a, std::size_t b) const {
  const DriftVariance& before = drift_[std::min(a, b)];
  const DriftVariance& after = drift_[std::max(a, b)];
  return {
      .heading_rad = std::hypot(sigmas.heading_rad, sigma(after.heading - before.heading)),
      .horizontal_m = std::hypot(sigmas.horizontal_m, sigma(after.horizontal - before.horizontal)),
      .vertical_m = std::hypot(sigmas.vertical_m, sigma(after.vertical - before.vertical))};
}

// By odometry.
SE3 KeyframeGraph::motion(std::size_t from, std::size_t to) const {
  return keyframes_[from].T_world_camera.inverse() * keyframes_[to].T_world_camera;
}

// Expressed between the nodes nearest to its keyframes, with the drift of odometry in between.
Edge KeyframeGraph::edge(const Loop& loop, std::size_t count) const {
  const std::size_t from = nearest_node(loop.from, count);
  const std::size_t to = nearest_node(loop.to, count);
  const EdgeSigmas sigmas =
      with_drift(with_drift(loop.sigmas, loop.from, nodes_[from]), loop.to, nodes_[to]);
  return {
      .from = from,
      .to = to,
      .T_from_to = motion(nodes_[from], loop.from) * loop.T_from_to * motion(loop.to, nodes_[to]),
      .sigmas = sigmas,
      .is_loop = true};
}

// From the known map, the last node.
Edge KeyframeGraph::edge(const Anchor& anchor, std::size_t count) const {
  const std::size_t to = nearest_node(anchor.keyframe, count);
  return {.from = count,
          .to = to,
          .T_from_to = anchor.T_known_camera * motion(anchor.keyframe, nodes_[to]),
          .sigmas = anchor.sigmas,
          .is_loop = true};
}

Edge KeyframeGraph::edge_to_next(std::size_t node) const {
  const std::size_t a = nodes_[node];
  const std::size_t b = nodes_[node + 1];
  return {.from = node,
          .to = node + 1,
          .T_from_to = motion(a, b),
          .sigmas = {.heading_rad = sigma(drift_[b].heading - drift_[a].heading),
                     .horizontal_m = sigma(drift_[b].horizontal - drift_[a].horizontal),
                     .vertical_m = sigma(drift_[b].vertical - drift_[a].vertical)}};
}

std::vector<SE3> KeyframeGraph::node_poses() const {
  std::vector<SE3> poses;
  for (const std::size_t keyframe : nodes_) poses.push_back(keyframes_[keyframe].T_world_camera);
  if (T_world_known_) poses.push_back(*T_world_known_);
  return poses;
}

std::vector<DriftCorrection> KeyframeGraph::node_corrections() const {
  std::vector<DriftCorrection> corrections = corrections_;
  if (T_world_known_) corrections.push_back(known_correction_);
  return corrections;
}

PoseGraph KeyframeGraph::graph() const {
  PoseGraph graph{.odometry = node_poses(), .edges = {}};
  for (std::size_t node = 0; node < nodes_.size(); ++node) {
    const Keyframe& keyframe = keyframes_[nodes_[node]];
    if (node + 1 < nodes_.size()) graph.edges.push_back(edge_to_next(node));
    if (keyframe.height_sigma_m) {
      graph.heights.push_back({node, std::max(kMinSigma, *keyframe.height_sigma_m)});
    }
  }
  for (const Loop& loop : loops_) {
    const Edge closed = edge(loop, nodes_.size());
    if (closed.from != closed.to) graph.edges.push_back(closed);
  }
  for (const Anchor& anchor : anchors_) {
    graph.edges.push_back(edge(anchor, nodes_.size()));
  }
  return graph;
}

double KeyframeGraph::residual_norm(const Loop& loop) const {
  return loop_closure::residual_norm({.odometry = node_poses(), .edges = {}}, node_corrections(),
                                     edge(loop, nodes_.size()));
}

const LinearGraph& KeyframeGraph::linear() const {
  if (linear_ && age_s(nodes_[linear_nodes_ - 1]) > kMaxLinearAge_s) linear_.reset();
  if (!linear_) {
    linear_.emplace(graph(), node_corrections());
    linear_nodes_ = nodes_.size();
  }
  return *linear_;
}

EdgeCheck KeyframeGraph::check(const Loop& loop) const {
  const LinearGraph& graph = linear();
  return graph.check(edge(loop, linear_nodes_));
}

EdgeCheck KeyframeGraph::check(const Anchor& anchor) const {
  const LinearGraph& graph = linear();
  Edge checked = edge(anchor, linear_nodes_);
  checked.sigmas = with_drift(checked.sigmas, anchor.keyframe, nodes_[checked.to]);
  return graph.check(checked);
}

void KeyframeGraph::optimize() {
  take_pending();
  linear_.reset();
  std::vector<DriftCorrection> corrections = node_corrections();
  loop_closure::optimize(graph(), corrections);
  if (T_world_known_) {
    known_correction_ = corrections.back();
    corrections.pop_back();
  }
  corrections_ = std::move(corrections);
}

bool KeyframeGraph::refine() {
  if (!is_thinned() && pending_.empty()) return false;
  std::vector<std::size_t> nodes;
  std::vector<DriftCorrection> corrections;
  for (std::size_t k = 0; k < keyframes_.size(); ++k) {
    const bool due = nodes.empty() || seconds_between(keyframes_[nodes.back()].stamp,
                                                      keyframes_[k].stamp) >= options_.node_step_s;
    if (!due && !is_beside_break(k)) continue;
    nodes.push_back(k);
    corrections.push_back(correction(k));
  }
  nodes_ = std::move(nodes);
  corrections_ = std::move(corrections);
  node_step_s_ = options_.node_step_s;
  loops_ = all_loops_;
  pending_.clear();
  optimize();
  return true;
}

}  // namespace apvi::loop_closure
