// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "apvi/core/stamp.hpp"

namespace apvi::vio {

/// One corner as one camera sees it in one frame.
struct Observation {
  std::int64_t id = 0;                              ///< of the track, never used again
  int camera = 0;                                   ///< 0: the first of the rig
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  ///< in the image as recorded
  Eigen::Vector2d point = Eigen::Vector2d::Zero();  ///< x/z, y/z in the camera frame, undistorted
  Eigen::Vector2d velocity =
      Eigen::Vector2d::Zero();  ///< of `point` [1/s]; zero in its first frame
  int track_length = 1;         ///< frames up to and with this one
};

/// Whether a frame can be worked with, and if not, why. A frame that cannot has no observations.
///
/// - `wrong_size`: not the camera's resolution, a pixel format that is not understood, or no image.
/// - `featureless`: all of one brightness, or hardly a track was found again (something passed
///   before the lens). For a short while the tracks wait for the next frame.
/// - `repeated`: the stamp or every pixel is that of the last good frame. No track grows older.
/// - `out_of_order`: older than a frame before it; left out as if it had not come.
enum class FrameQuality { good, wrong_size, featureless, repeated, out_of_order };

/// What became of the tracks in one frame.
struct FrameStatistics {
  FrameQuality quality = FrameQuality::good;
  int tracked = 0;          ///< continued from the frame before
  int detected = 0;         ///< new ones
  int stable = 0;           ///< seen in `TrackerConfig::stable_frames` consecutive frames
  int lost_flow = 0;        ///< optical flow failed or did not come back where it started
  int lost_epipolar = 0;    ///< outliers of the essential matrix
  double spread = 0.0;      ///< share of the image's grid cells that hold a track, in [0, 1]
  double brightness = 0.0;  ///< mean grey value, in [0, 255]
};

/// A frame after the front end.
struct TrackedFrame {
  Stamp stamp;
  std::vector<Observation> observations;  ///< by camera, then by id
  FrameStatistics statistics;
};

}  // namespace apvi::vio
