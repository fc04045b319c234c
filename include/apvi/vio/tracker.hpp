// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/vio/observation.hpp"

namespace apvi::vio {

struct TrackerConfig {
  int max_tracks = 150;
  double min_distance_px = 25.0;
  int stable_frames = 10;
  bool equalize = true;
  double max_backward_px = 0.5;
  double max_epipolar_px = 1.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("max_tracks", max_tracks, Range{10, 2000}, "corners followed at once");
    v("min_distance_px", min_distance_px, Range{1.0, 500.0}, "between corners [px]");
    v("stable_frames", stable_frames, Range{2, 1000},
      "a track seen in so many consecutive frames is stable");
    v("equalize", equalize, "even out the contrast (CLAHE) before corners are looked for");
    v("max_backward_px", max_backward_px, Range{0.01, 100.0},
      "a track whose flow does not come back this near is dropped [px]");
    v("max_epipolar_px", max_epipolar_px, Range{0.01, 100.0},
      "a track this far off its epipolar line is dropped [px]");
  }
};

/// The visual front end: follows corners from frame to frame. Shi-Tomasi corners spread over a
/// grid, pyramidal Lucas-Kanade flow predicted by the gyro, checked backward and against an
/// essential matrix. With two cameras the corners of the first are also looked for in the second.
class Tracker {
 public:
  Tracker(const TrackerConfig& config, const std::vector<CameraCalibration>& cameras);
  ~Tracker();
  Tracker(Tracker&&) noexcept;
  Tracker& operator=(Tracker&&) noexcept;

  /// One frame: an image of every camera (grey, BGR or BGRA of 8 or 16 bits, or floats in [0, 1];
  /// an empty one was lost). `R_before_now`: rotation of the body since the newest frame given
  /// before, whatever its quality, now to before, when the gyro knows it. A little bias does no
  /// harm. Never throws for what a camera can deliver: the statistics say what was wrong.
  TrackedFrame process(const std::vector<cv::Mat>& images, Stamp stamp,
                       const std::optional<Eigen::Quaterniond>& R_before_now);

  /// Forgets all tracks; ids go on.
  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace apvi::vio
