// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/vio/config.hpp"
#include "vio/frontend/epipolar_check.hpp"
#include "vio/window/observation.hpp"
#include "vio/window/window.hpp"

namespace apvi::vio {

/// Tracks of the first camera that two frames have in common, with their points in both.
struct Matches {
  std::vector<std::int64_t> ids;
  std::vector<PointPair> pairs;
};
Matches match(const TrackedFrame& first, const TrackedFrame& second);

/// How well a window explains the images.
struct StartFit {
  /// Mean of the squared reprojection errors, each limited to the square of
  /// `VisionConfig::max_reprojection_px`, with the best depth of every landmark [px²].
  double cost = std::numeric_limits<double>::infinity();
  double inliers = 0.0;  ///< share of the landmarks that fit
};

/// A motion after bundle adjustment. The world is the first body frame.
struct StartSolution {
  Window window;
  StartFit fit;

  SE3 motion() const;  ///< from the first frame of the window to the last
};

/// Bundle adjustment of evenly spaced frames, from `base` to the last.
class StartAttempt {
 public:
  StartAttempt(const std::vector<TrackedFrame>& frames, std::size_t base, const Config& config,
               const Rig& rig);

  /// From a motion of the camera between the first and the last frame, of which `matches` are the
  /// common tracks. nullopt when other frames do not fit to it.
  std::optional<StartSolution> solve(SE3 motion, const Matches& matches) const;
  /// Largest error of an inlier, on the plane z = 1.
  double max_error() const { return config_.vision.max_reprojection_px / focal_; }

 private:
  void adjust(Window& window) const;

  Config config_;
  const Rig& rig_;
  SE3 T_body_camera_;
  double focal_;
  std::vector<const TrackedFrame*> chosen_;
};

/// Adds a frame with the observations of its first camera.
void add_frame(Window& window, const TrackedFrame& tracked, const SE3& T_world_body);
/// Median depth of the landmarks that the newest frame observes, in its camera; zero without any.
double median_depth(const Window& window);

}  // namespace apvi::vio
