// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "apvi/localization/options.hpp"
#include "core/worker.hpp"
#include "localization/active_sensors.hpp"
#include "localization/fusion_stage.hpp"
#include "localization/image_monitor.hpp"
#include "localization/map_feed.hpp"
#include "localization/smoother.hpp"
#include "vio/frontend/tracker.hpp"

namespace apvi::localization {

/// Front end and fusion stage, in order of time: called directly (`sequential`), or each on its own
/// thread with queues in between that block when full (`replay`: bit-identical result) or with
/// images skipped when falling behind (`realtime`).
class VisualPipeline {
 public:
  /// Called once per frame in order, from the last stage's thread.
  using Sink = std::function<void(const FrameOutput&)>;

  /// Called with the map-to-odometry transform of a new keyframe, from the same thread.
  using MapToOdometry = std::function<void(const SE3&)>;

  /// `map`, if given, receives map frames; it must outlive this object.
  VisualPipeline(const Options& options, const Rig& rig, const ActiveSensors& sensors, Sink sink,
                 MapSink* map = nullptr, MapToOdometry map_to_odometry = {});

  /// Queues a frame; blocks when the queue is full. Rethrows an exception of a stage's thread.
  void push(FrameJob job);
  /// Processes everything queued and stops. Rethrows an exception of a stage's thread.
  void finish();
  /// `Smoother::adjust`, after `finish`.
  void adjust(const std::function<void(int iteration)>& progress);
  /// Stops immediately: queued frames are discarded.
  void stop();

  /// Images skipped in real time because newer ones were waiting.
  std::size_t dropped_images() const { return dropped_images_; }
  /// By camera. Valid after `finish` only.
  const std::vector<ImageCounts>& image_counts() const { return image_monitor_.counts(); }
  /// Valid after `finish` only.
  const FusionStage& fusion_stage() const { return fusion_stage_; }
  /// Nothing when the trajectory is not smoothed.
  const Smoother* smoother() const { return smoother_ ? &*smoother_ : nullptr; }

 private:
  struct Tracked {
    FrameJob job;
    std::optional<vio::TrackedFrame> frame;
    cv::Mat image;  ///< of camera 0, for the map
    double decode_s = 0.0;
    double track_s = 0.0;
  };

  Tracked track(FrameJob job, bool process_image);
  void fuse(const Tracked& tracked);

  RunMode mode_;
  ImageMonitor image_monitor_;
  vio::Tracker tracker_;
  std::optional<Eigen::Quaterniond> skipped_rotation_;  // body rotation over skipped images
  FusionStage fusion_stage_;
  Sink sink_;
  MapSink* map_;
  MapToOdometry map_to_odometry_;
  std::optional<MapFeed> map_feed_;
  std::optional<Smoother> smoother_;
  std::size_t dropped_images_ = 0;
  // Last members, downstream worker first: threads stop before the members they use.
  std::unique_ptr<Worker<Tracked>> fusion_worker_;
  std::unique_ptr<Worker<FrameJob>> tracking_worker_;
};

}  // namespace apvi::localization
