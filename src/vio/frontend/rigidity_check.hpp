// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "apvi/core/stamp.hpp"

namespace apvi::vio {

/// Position of a track in one frame, on the plane z = 1 of the camera.
struct TrackPoint {
  std::int64_t id = 0;
  Eigen::Vector2d point = Eigen::Vector2d::Zero();
};

/// Rejects tracks that violate the epipolar geometry of a rigid scene: wrong matches, marine snow,
/// fish, occlusion corners. Motion between consecutive frames is often too small, so frames of up
/// to half a second ago are compared as well.
class RigidityCheck {
 public:
  /// `threshold`: maximum distance from the epipolar line, on the plane z = 1.
  explicit RigidityCheck(double threshold) : threshold_(threshold) {}

  /// Returns one flag per track of the current frame: 1 for inliers. Points are sorted by id.
  /// `R_now_last`: rotation of the camera since the last frame added, if known from the gyro.
  std::vector<char> check(Stamp stamp, const std::vector<TrackPoint>& now,
                          const std::optional<Eigen::Quaterniond>& R_now_last);
  /// Adds the current frame, with its remaining and new tracks.
  void add(Stamp stamp, const std::vector<TrackPoint>& points);
  void clear();

 private:
  struct Frame {
    Stamp stamp;
    std::vector<TrackPoint> points;
    std::optional<Eigen::Quaterniond>
        R_last_frame;  // rotation from this frame to the last one added
  };

  std::vector<const Frame*> to_compare(Stamp stamp) const;
  std::optional<Eigen::Quaterniond> compare(const Frame& earlier,
                                            const std::vector<TrackPoint>& now,
                                            const std::optional<Eigen::Quaterniond>& R_now_last,
                                            std::vector<char>& is_inlier) const;

  double threshold_;
  std::deque<Frame> frames_;                      // oldest first
  std::optional<Eigen::Quaterniond> R_now_last_;  // of the current frame
};

}  // namespace apvi::vio
