// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/localization/options.hpp"
#include "localization/active_sensors.hpp"
#include "localization/fusion_stage.hpp"
#include "localization/map_sink.hpp"
#include "localization/odometry_drift.hpp"
#include "loop_closure/async_loop_closer.hpp"

namespace apvi::localization {

/// The pose graph of the whole dive, beside the odometry: keyframes while vision is stable, and the
/// fused pose every second otherwise. Odometry is not changed. `add` is called from the last
/// stage's thread; the graph has a thread of its own, except in `sequential` mode.
class Smoother {
 public:
  /// `for_map`: whether a map follows the corrections of the graph.
  Smoother(const Options& options, const Rig& rig, const ActiveSensors& sensors, bool for_map);

  /// Every frame, in order of time, with its image as recorded (may be empty) and what it tells the
  /// map, if anything.
  void add(const FrameOutput& output, const cv::Mat& image, const std::optional<MapFrame>& news);
  /// After `add`: moves it from the frame of the VIO window, which begins anew after a loss of
  /// vision, to that of the graph's odometry, and adds the corrections of the graph.
  void connect(MapFrame& news) const;
  /// Processes what is queued. Rethrows an exception of the graph's thread.
  void finish();
  /// The bundle adjustment of the whole dive, if it is on, after `finish`. Takes seconds to
  /// minutes; `progress` receives the number of the iteration.
  void adjust(const std::function<void(int iteration)>& progress = {});
  /// Discards what is queued.
  void stop();

  /// Where the odometry frame lies in the frame of the closed loops, or of the known map once it
  /// has been found, by the newest keyframe. Any thread.
  SE3 T_map_odom() const;
  /// The odometry with the corrections of the graph, interpolated between keyframes, in the frame
  /// of the known map if it was found. After `finish` or `stop`.
  Trajectory smoothed(const Trajectory& odometry) const;
  /// After `finish` or `stop`.
  const loop_closure::LoopCloser& closer() const { return closer_.closer(); }
  const std::vector<double>& keyframe_seconds() const { return closer_.seconds(); }

 private:
  /// A keyframe of the graph. The image may be older than the pose of odometry.
  struct Keyframe {
    SE3 T_odom_body;    ///< fused, at the stamp of the frame
    SE3 T_graph_image;  ///< of the body when the image was taken; the graph's odometry
    SE3 T_image_body;   ///< motion between the two times
    SE3 T_body_camera;
    SE3 T_graph_body() const { return T_graph_image * T_image_body; }
  };

  void move_window(const MapFrame& news);
  void place_window(const FrameOutput& output);
  void add_image(const FrameOutput& output, const MapFrame& news, bool continues);
  void add_pose(const FrameOutput& output, const cv::Mat& image);
  bool is_search_due(const FrameOutput& output) const;
  SE3 predicted(const SE3& T_odom_body) const;
  void push(const Keyframe& keyframe, Stamp stamp, const cv::Mat& image, bool vio_continues);
  SE3 correction(const StampedPose& pose, std::size_t keyframe) const;

  SE3 T_body_camera_;
  bool height_is_measured_;
  double drift_factor_;
  bool has_known_map_;
  OdometryDrift drift_;
  std::vector<Keyframe> keyframes_;
  std::vector<Stamp> stamps_;                 // of the keyframes
  std::optional<Stamp> last_image_;           // of a keyframe
  std::map<Stamp, std::size_t> in_window_;    // keyframes of the present window
  SE3 T_graph_window_;                        // of the present window
  std::vector<std::pair<Stamp, SE3>> moved_;  // camera poses that the graph has not heard of
  mutable std::mutex mutex_;
  SE3 T_graph_odom_;  // by the newest keyframe; guarded by mutex_
  loop_closure::AsyncLoopCloser closer_;
};

}  // namespace apvi::localization
