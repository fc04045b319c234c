// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "apvi/core/constants.hpp"
#include "vio/initialization/initializer.hpp"

namespace apvi::vio {

/// Input of the initialization: keyframes, their common tracks, and the inertial data between them.
struct StartProblem {
  struct View {
    int keyframe = 0;
    Eigen::Vector2d point = Eigen::Vector2d::Zero();  ///< on the plane z = 1
  };
  /// Observations of one corner by the first camera, in order of time, at least two.
  struct Track {
    std::vector<View> views;
  };

  std::vector<std::size_t> frames;  ///< frame index of each keyframe
  /// [k]: samples from keyframe k - 1 to k, including both ends; [0] is empty.
  std::vector<std::vector<ImuSample>> imu;
  std::vector<Track> tracks;
  SE3 T_body_camera;
  imu::Noise noise;
  double gravity = kStandardGravity;

  int keyframes() const { return static_cast<int>(frames.size()); }
};

/// Concatenates the samples of consecutive spans without repeating the shared ends.
std::vector<ImuSample> join(const std::vector<InitFrame>& frames, std::size_t after,
                            std::size_t until);

/// At most `max_count` evenly spaced ones of `count` indices from `first` on, including the first
/// and the last.
std::vector<std::size_t> choose_keyframes(std::size_t first, std::size_t count, int max_count);

/// Calls `visit` with both observations of every track of the first camera that both frames have.
template <typename Visit>
void visit_common_tracks(const TrackedFrame& a, const TrackedFrame& b, const Visit& visit) {
  auto it = b.observations.begin();
  const auto end = b.observations.end();
  for (const FeatureObservation& seen : a.observations) {
    if (seen.camera != 0) break;
    while (it != end && it->camera == 0 && it->id < seen.id) ++it;
    if (it == end || it->camera != 0) break;
    if (it->id == seen.id) visit(seen, *it);
  }
}

/// Number of tracks of the first camera common to both frames.
int common_tracks(const TrackedFrame& a, const TrackedFrame& b);

/// The problem of the frames from `first` to the last, thinned evenly to at most `keyframes`.
StartProblem make_start_problem(const std::vector<InitFrame>& frames, std::size_t first,
                                int keyframes);

}  // namespace apvi::vio
