// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/loop/place.hpp"
#include "apvi/loop/pose_graph.hpp"

namespace apvi::loop {

struct LoopOptions {
  double least_age_s = 20.0;  ///< nearer in time odometry knows better
  int features = 800;         ///< of a picture, at most
  int places = 1000;          ///< kept at most; beyond it every second one goes
  int least_inliers = 25;     ///< points that must agree where a camera stands
  double pixel_sigma = 1.0;   ///< of a feature, both pictures' [px]
  /// How odometry drifts in the square root of a second, one sigma.
  double drift_m = 0.004;
  double drift_deg = 0.1;
};

/// A keyframe whose place in the corrected world has changed.
struct Relocation {
  Stamp stamp;
  SE3 T_after_before;  ///< of the corrected world there, from what was told last
};

/// Finds that a vehicle is back where it has been, and where its path must have run then. Odometry
/// keeps its own world; what is told is how the corrected world differs from it. Places are looked
/// for where odometry, as corrected so far, would have them in the picture; no index of words, as a
/// vehicle with DVL and IMU never drifts by more than what a picture shows.
class LoopCloser {
 public:
  LoopCloser(const LoopOptions& options, const Pinhole& camera);

  /// A keyframe's 8-bit grey picture and where odometry has its camera, in order of time. What it
  /// changes: relocations of keyframes in order of time, the last of this one; mostly nothing.
  /// An empty picture is not looked at.
  std::vector<Relocation> add(Stamp stamp, const cv::Mat& grey, const SE3& T_world_camera);
  /// The end of the way: relocations as `add`'s, for what was met since it told the last.
  std::vector<Relocation> settle();
  /// Odometry has changed its mind about a keyframe; nothing when it is not known.
  void move(Stamp stamp, const SE3& T_world_camera);

  /// How often a place has been met again.
  std::size_t closures() const { return loops_.size(); }

 private:
  struct Keyframe {
    Stamp stamp;
    SE3 T_world_camera;  ///< odometry's
    Correction told;
  };
  struct Kept {
    std::size_t keyframe = 0;
    Place place;
  };
  /// Two keyframes, how they stand to each other.
  struct Loop {
    std::size_t from = 0;
    std::size_t to = 0;
    SE3 T_from_to;
  };
  struct Candidate {
    const Kept* kept = nullptr;
    double shown = 0.0;
  };
  void add_keyframe(Stamp stamp, const SE3& T_world_camera);
  bool is_elsewhere() const;
  Place make_place(const cv::Mat& grey);
  void keep(Place place);
  double age_s(std::size_t keyframe) const;
  std::size_t nearest_node(std::size_t keyframe) const;
  Correction correction(std::size_t keyframe) const;
  SE3 corrected(std::size_t keyframe) const;
  double shown(const Kept& kept, const SE3& T_camera_world) const;
  std::vector<Candidate> candidates() const;
  bool is_likely(const Loop& loop) const;
  bool close(const Place& place);
  bool is_due() const;
  std::vector<SE3> node_poses() const;
  Edge edge(const Loop& loop) const;
  Edge edge_to_next(std::size_t node) const;
  void bend();
  std::vector<Relocation> relocations();

  LoopOptions options_;
  Pinhole camera_;
  std::vector<Keyframe> keyframes_;
  std::map<Stamp, std::size_t> by_stamp_;
  std::vector<std::size_t> nodes_;       ///< of the graph: keyframes some seconds apart
  std::vector<Correction> corrections_;  ///< at the nodes
  std::vector<Loop> loops_;
  std::vector<Kept> places_;
  bool has_news_ = false;      ///< a loop that has not been told
  std::optional<Stamp> bent_;  ///< when last
};

}  // namespace apvi::loop
