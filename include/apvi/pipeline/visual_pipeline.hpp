// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <utility>

#include "apvi/core/worker.hpp"
#include "apvi/pipeline/localizer.hpp"
#include "apvi/pipeline/map_feed.hpp"
#include "apvi/pipeline/run_config.hpp"
#include "apvi/vio/tracker.hpp"

namespace apvi::pipeline {

/// Front end and localizer behind the navigator, in order of time: called directly (`sequential`),
/// or each on a thread of its own with queues between that block (`replay`: the same result to the
/// bit) or let go of the oldest images (`realtime`).
class VisualPipeline {
 public:
  /// Called once per frame in order, from the last stage's thread.
  using Sink = std::function<void(const FrameOutput&)>;

  /// `map`, when given, gets what the map is made of; it must outlive this.
  VisualPipeline(const RunConfig& config, const Rig& rig, std::size_t cameras, Sink sink,
                 MapSink* map = nullptr);

  /// Takes a frame in; waits when the queue is full, but in real time. Throws what a stage has
  /// thrown.
  void push(FrameJob job);
  /// Soft stop: everything taken in is finished. Throws what a stage has thrown.
  void finish();
  /// Hard stop: what is in the queues is abandoned.
  void stop();

  /// Images that were not looked at because a newer one was waiting.
  std::size_t dropped_images() const { return dropped_images_; }
  /// After `finish` only.
  const Localizer& localizer() const { return localizer_; }

 private:
  struct Tracked {
    FrameJob job;
    std::optional<vio::TrackedFrame> frame;
    cv::Mat image;  ///< of camera 0, for the map
    double decode_s = 0.0;
    double track_s = 0.0;
  };

  Tracked track(FrameJob job, bool look);
  void localize(const Tracked& tracked);

  RunMode mode_;
  vio::Tracker tracker_;
  std::optional<Eigen::Quaterniond> skipped_turn_;  // body rotation over images not looked at
  Localizer localizer_;
  Sink sink_;
  MapSink* map_;
  std::optional<MapFeed> map_feed_;
  std::size_t dropped_images_ = 0;
  // Last, the downstream one first: threads end before what they use.
  std::unique_ptr<Worker<Tracked>> localize_worker_;
  std::unique_ptr<Worker<FrameJob>> track_worker_;
};

}  // namespace apvi::pipeline
