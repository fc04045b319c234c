// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/rig.hpp"

namespace apvi::pipeline {

/// A landmark of the window.
struct MapPoint {
  std::int64_t id = 0;  ///< never used again for another
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  double sigma_m = 0.0;  ///< along the ray
};

/// What localization tells the map at a camera frame. Poses are the body's, in the world of the
/// output.
struct MapFrame {
  Stamp stamp;              ///< of the frame, on the inertial clock
  Stamp image_stamp;        ///< as recorded
  cv::Mat image;            ///< as recorded by camera 0; empty: no picture for the map
  bool held_out = false;    ///< for evaluation, never to be learnt from
  std::int64_t number = 0;  ///< of a held-out one among all that the recording has
  SE3 T_world_body;
  std::vector<MapPoint> points;          ///< that the frame sees
  std::vector<Eigen::Vector3d> ranged;   ///< what the DVL's beams met since the frame before [m]
  std::vector<StampedPose> window;       ///< the keyframes as they are believed to stand now
  std::optional<Stamp> newest_keyframe;  ///< of the window, before this frame
  bool vio_failing = false;
};

/// Whoever makes the map. `take` is called in order of time from the last stage's thread.
/// Localization goes on whatever becomes of the map, so that neither `take` nor `finish` throws:
/// what goes wrong is for the sink to keep and for its owner to ask.
class MapSink {
 public:
  virtual ~MapSink() = default;
  /// Before the first frame.
  virtual void begin(const Rig& rig) = 0;
  /// May wait, but in real time.
  virtual void take(MapFrame frame) = 0;
  /// After the last frame: everything taken is worked in.
  virtual void finish() = 0;
  /// For the progress line; from any thread.
  virtual std::string status() const = 0;
};

}  // namespace apvi::pipeline
