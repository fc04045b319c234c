// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "apvi/vio/initializer.hpp"

namespace apvi::vio {

/// What a start is made from: a few of the frames, what they see in common, how the IMU moved
/// between them.
struct StartProblem {
  struct View {
    int keyframe = 0;
    Eigen::Vector2d point = Eigen::Vector2d::Zero();  ///< on the plane z = 1
  };
  /// Sightings of one corner by the first camera, in order of time, two at least.
  struct Track {
    std::vector<View> views;
  };

  std::vector<std::size_t> frames;  ///< which frame each keyframe is
  /// [k]: from keyframe k - 1 to k, ends included; [0] is empty.
  std::vector<std::vector<ImuSample>> imu;
  std::vector<Track> tracks;
  SE3 T_body_camera;
  imu::Noise noise;
  double gravity = 9.80665;

  int keyframes() const { return static_cast<int>(frames.size()); }
};

/// The samples of several spans that follow each other, without repeating the shared ends.
std::vector<ImuSample> join(const std::vector<InitFrame>& frames, std::size_t after,
                            std::size_t until);

/// Tracks that the first camera sees in both frames.
int common_tracks(const TrackedFrame& a, const TrackedFrame& b);

/// The problem of the frames `first` to the last, thinned evenly to `keyframes` of them at most.
StartProblem make_start_problem(const std::vector<InitFrame>& frames, std::size_t first,
                                int keyframes);

}  // namespace apvi::vio
