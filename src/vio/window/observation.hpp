// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "apvi/core/stamp.hpp"

namespace apvi::vio {

/// Observation of one corner by one camera in one frame.
struct FeatureObservation {
  std::int64_t id = 0;                              ///< track id, never reused
  int camera = 0;                                   ///< index in the rig
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  ///< in the recorded image [px]
  Eigen::Vector2d point = Eigen::Vector2d::Zero();  ///< x/z, y/z in the camera frame, undistorted
  int track_length = 1;                             ///< number of frames up to this one
};

/// Quality of a frame. A frame that is not good has no observations.
///
/// - `wrong_size`: wrong resolution, unsupported pixel format, or no image.
/// - `featureless`: uniform image, or hardly any track was found again (an obstacle in front of the
///   lens). Tracks are kept for a short time.
/// - `repeated`: the stamp or every pixel equals the last good frame. Track lengths do not change.
/// - `out_of_order`: older than a previous frame; ignored.
enum class FrameQuality { good, wrong_size, featureless, repeated, out_of_order };

/// Track statistics of one frame.
struct FrameStatistics {
  FrameQuality quality = FrameQuality::good;
  int tracked = 0;          ///< continued from the previous frame
  int detected = 0;         ///< new tracks
  int stable = 0;           ///< tracked for `TrackerConfig::stable_s` or longer
  int lost_flow = 0;        ///< rejected by optical flow or its forward-backward check
  int lost_epipolar = 0;    ///< rejected by the epipolar check
  double spread = 0.0;      ///< fraction of grid cells with a track, in [0, 1]
  double brightness = 0.0;  ///< mean gray value, in [0, 255]
};

/// Output of the front end for one frame.
struct TrackedFrame {
  Stamp stamp;
  std::vector<FeatureObservation> observations;  ///< by camera, then by id
  FrameStatistics statistics;
};

}  // namespace apvi::vio
