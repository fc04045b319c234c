// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "loop_closure/loop_closer.hpp"
#include "support/textured_floor.hpp"

/// Dives over the textured floor and the maps that they leave.
namespace apvi::loop_closure {

using test::camera_looking_down;
using test::floor_camera;
using test::render_floor;

inline constexpr double kHeight_m = 2.0;
inline constexpr double kStep_m = 0.3;  // between images

using Path = std::vector<SE3>;  ///< poses of the camera
using Look = std::function<cv::Mat(const SE3&)>;

/// Along x from `from` to `to`.
inline Path line(double from, double to, double y, double heading = 0.0) {
  Path path;
  for (double x = from; x < to; x += kStep_m) {
    path.push_back(camera_looking_down({x, y, kHeight_m}, heading));
  }
  return path;
}

inline Path joined(Path a, const Path& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

/// A dive with exact odometry in a frame of its own.
inline LoopCloser dive(const CloserOptions& options, const Path& path, const SE3& T_world_truth,
                       const Look& look = render_floor) {
  LoopCloser closer(options, floor_camera());
  for (std::size_t k = 0; k < path.size(); ++k) {
    Keyframe keyframe;
    keyframe.stamp = Stamp{1'000'000'000 + static_cast<std::int64_t>(k) * 600'000'000};
    keyframe.T_world_camera = T_world_truth * path[k];
    keyframe.drift = {.heading = 1e-8, .horizontal = 1e-7, .vertical = 1e-8};
    closer.add(keyframe, look(path[k]));
  }
  closer.flush();
  return closer;
}

/// The map that a dive leaves, in the frame of the floor.
inline PlaceMap map_of(const Path& path, const Look& look = render_floor) {
  return dive(closer_options(SmoothingOptions{}), path, SE3::identity(), look).place_map();
}

inline CloserOptions in_map(PlaceMap map) {
  CloserOptions options = closer_options(SmoothingOptions{});
  options.known_map = std::make_shared<KnownMap>(std::move(map), floor_camera(), 1.0);
  return options;
}

}  // namespace apvi::loop_closure
