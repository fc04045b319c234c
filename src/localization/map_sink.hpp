// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apvi/geometry/scale_change.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/rig.hpp"
#include "loop_closure/correction_log.hpp"

namespace apvi::localization {

/// A landmark of the window.
struct MapPoint {
  std::int64_t id = 0;  ///< never reused
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  double sigma_m = 0.0;  ///< along the ray
};

/// Data that localization passes to the map at a camera frame. Poses are of the body, in the frame
/// of the odometry that the pose graph corrects.
struct MapFrame {
  Stamp stamp;                       ///< of the frame, on the IMU clock
  Stamp image_stamp;                 ///< as recorded
  cv::Mat image;                     ///< raw image of camera 0; empty: no image for the map
  std::function<cv::Mat()> mask;     ///< see ImageFrame
  bool held_out = false;             ///< for evaluation, never used for mapping
  std::int64_t heldout_index = 0;    ///< index among the recording's held-out images
  SE3 T_world_body;                  ///< when the image was taken
  std::optional<SE3> T_body_camera;  ///< as calibrated so far; empty: as in the rig
  std::vector<MapPoint> points;      ///< landmarks observed in the frame
  std::vector<Eigen::Vector3d> range_points;  ///< DVL beam end points since the previous frame [m]
  std::vector<StampedPose> window;            ///< current poses of the keyframes in the window
  std::optional<Stamp> newest_keyframe;       ///< in the window, before this frame
  bool vio_failing = false;
  std::optional<ScaleChange> scale_change;  ///< of the map so far, before this frame
  /// Corrections of the keyframes by the pose graph of the whole dive, and the number of its
  /// keyframes up to this frame; null without a graph.
  std::shared_ptr<loop_closure::CorrectionLog> corrections;
  std::size_t graph_keyframes = 0;
};

/// Interface of the mapper. `push` is called in order of time from the last stage's thread. Mapping
/// failures must not stop localization, so neither `push` nor `finish` throws: the implementation
/// stores the error and its owner asks for it.
class MapSink {
 public:
  virtual ~MapSink() = default;
  /// May block, except in real time.
  virtual void push(MapFrame frame) = 0;
  /// Called after the last frame: processes everything queued.
  virtual void finish() = 0;
  /// For the status line; callable from any thread.
  virtual std::string status() const = 0;
};

}  // namespace apvi::localization
