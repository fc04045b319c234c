// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "apvi/vio/config.hpp"
#include "vio/window/observation.hpp"

namespace apvi::vio {

/// Visual front end: tracks corners between frames. Shi-Tomasi corners spread over a grid,
/// pyramidal Lucas-Kanade flow predicted by the gyro, with a forward-backward check and an epipolar
/// check. With two cameras, the corners of the first are also matched in the second.
class Tracker {
 public:
  Tracker(const TrackerConfig& config, const std::vector<CameraCalibration>& cameras);
  ~Tracker();
  Tracker(Tracker&&) noexcept;
  Tracker& operator=(Tracker&&) noexcept;

  /// Processes one frame: one image per camera (gray, BGR or BGRA; 8 or 16 bits, or floats in [0,
  /// 1]; empty if lost). `R_before_now`: rotation of the body since the previous call, whatever the
  /// quality of that frame, from the current to the previous frame, if known from the gyro. A small
  /// bias is harmless. Never throws on bad images: see the statistics.
  TrackedFrame process(const std::vector<cv::Mat>& images, Stamp stamp,
                       const std::optional<Eigen::Quaterniond>& R_before_now);

  /// Removes all tracks; ids continue.
  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace apvi::vio
