// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

namespace apvi::vio {

/// A track's place in one frame, on the plane z = 1 of the camera.
struct TrackPoint {
  std::int64_t id = 0;
  Eigen::Vector2d point = Eigen::Vector2d::Zero();
};

/// Finds the tracks that do not move as one rigid scene: wrong matches, marine snow, fish, corners
/// made by one thing in front of another. From a frame to the next most of these move too little
/// to be told from the scene, so frames some way back are compared as well.
class RigidityCheck {
 public:
  /// `threshold`: distance from the epipolar line that is still allowed, on the plane z = 1.
  explicit RigidityCheck(double threshold) : threshold_(threshold) {}

  /// One flag for every track of the present frame: 1 when it may stay. Both lists of points are
  /// in order of id. `R_now_last`: rotation of the camera since the last frame added, when the
  /// gyro knows it.
  std::vector<char> check(const std::vector<TrackPoint>& now,
                          const std::optional<Eigen::Quaterniond>& R_now_last);
  /// The frame that was checked becomes the last one, with the tracks that are left and new ones.
  void add(const std::vector<TrackPoint>& points);
  void clear();

 private:
  struct Frame {
    std::vector<TrackPoint> points;
    std::optional<Eigen::Quaterniond> R_last_frame;  // from this frame to the last one added
  };

  std::optional<Eigen::Quaterniond> compare(const Frame& earlier,
                                            const std::vector<TrackPoint>& now,
                                            const std::optional<Eigen::Quaterniond>& R_now_last,
                                            std::vector<char>& stays) const;

  double threshold_;
  std::deque<Frame> frames_;                      // the oldest first
  std::optional<Eigen::Quaterniond> R_now_last_;  // of the frame being checked
};

}  // namespace apvi::vio
