// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <cstddef>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apvi/slam/options.hpp"
#include "core/profiler.hpp"
#include "core/worker.hpp"
#include "localization/map_sink.hpp"
#include "loop_closure/async_loop_closer.hpp"
#include "mapping/mapper.hpp"
#include "slam/camera_conversion.hpp"
#include "slam/fair_mutex.hpp"
#include "slam/mapping_scheduler.hpp"

namespace apvi::slam {

/// How frames reach the mapper.
enum class MappingThread {
  none,      ///< on the caller's thread
  blocking,  ///< on a thread of its own; the caller waits while the queue is full
  dropping,  ///< on a thread of its own; the oldest frames are dropped when it is behind
};

struct AsyncMapperOptions {
  MappingThread thread = MappingThread::none;
  int threads = 2;  ///< of LibTorch on the mapper's thread
  double image_scale = 1.0;
  bool use_dvl_ranges = false;
  LoopClosureOptions loop_closure = {};
  bool has_lamp = false;  ///< of the rig
  mapping::MapperOptions mapper;
};

/// The method, with `automatic` resolved: by the pose graph of localization if there is one.
/// Features do not match in the moving light of a lamp, if nothing predicts where they are.
LoopClosureMethod resolve_loop_closure_method(LoopClosureMethod asked, bool has_graph,
                                              bool has_lamp);

/// What the mapper does after the last frame.
enum class FinalWork {
  finishing,  ///< in `finish`: the newest keyframes, which waited for neighbors
  refining,   ///< in `refine`
};

struct FinalProgress {
  FinalWork work = FinalWork::finishing;
  double fraction = 0.0;  ///< of the work
  double loss = 0.0;      ///< smoothed; of `refining` only
  bool ended = false;     ///< the last report of this work, complete or interrupted
};

/// Called on the mapper's thread, between two steps of the mapper.
struct AsyncMapperCallbacks {
  /// Whether to stop early; asked before every step.
  std::function<bool()> interrupted = [] { return false; };
  /// After every frame, and after every step of `refine`.
  std::function<void()> progress = [] {};
  /// Before the first and after every step of this work.
  std::function<void(const FinalProgress&)> final_progress = [](const FinalProgress&) {};
  /// Mapping has failed and is disabled; the map so far can be saved.
  std::function<void()> failed = [] {};
};

/// A map with the body poses of its keyframes.
struct MapCopy {
  mapping::Map map;
  Trajectory keyframes;
  std::int64_t iteration = 0;
};

/// Makes a map while frames come: conversion to tensors, loop closure, scheduling and the mapper's
/// thread, without files. A failure disables mapping; localization continues.
class AsyncMapper : public localization::MapSink {
 public:
  /// Throws InputError when the rig's first camera cannot be undistorted.
  AsyncMapper(const AsyncMapperOptions& options, const Rig& rig, AsyncMapperCallbacks callbacks);

  void push(localization::MapFrame frame) override;
  void finish() override;
  std::string status() const override;
  std::int64_t keyframe_count() const { return keyframe_count_; }
  std::int64_t gaussian_count() const { return gaussian_count_; }
  /// Whether mapping is disabled after a failure.
  bool failed() const { return failed_; }

  /// While paused, keyframes are added, but not optimized; any thread. `finish` and `refine` do
  /// not pause.
  void pause(bool paused) { paused_ = paused; }
  bool paused() const { return paused_; }
  /// Discards queued frames.
  void stop();
  /// Runs the final refinement. False when it was interrupted.
  bool refine();
  /// Of `refine`, as the options say or, if they do not, as the device allows.
  int final_iterations() const { return options_.mapper.trainer.final_iterations.value_or(0); }
  /// Continues from a checkpoint. Throws InputError when it is damaged.
  void resume(const std::filesystem::path& checkpoint);
  /// The exception that disabled mapping, if any. After `finish`.
  std::exception_ptr failure() const { return failure_; }

  /// A copy of the map; any thread. Empty before the first keyframe.
  MapCopy snapshot() const;
  /// The same for a look at it: with fewer Gaussians far from the camera if the map is large.
  MapCopy preview() const;
  /// Renders the map; any thread. Undefined tensors before the first keyframe.
  mapping::MapRendering render(const gaussians::View& view) const;

  /// Only while no frame is processed: in a callback, or after `finish`.
  const mapping::Mapper& mapper() const { return mapper_; }
  /// Poses of the body at the keyframes, corrected: those at which a camera mounted as in the rig
  /// is where the keyframe's is, whatever the self-calibration says. When `mapper` may be used.
  Trajectory keyframes() const;
  double training_s() const { return scheduler_.training_s(); }
  /// Time of the mapper's thread by activity [s].
  std::map<std::string, double> times() const;
  std::size_t dropped_keyframes() const { return dropped_; }
  /// Number of loop closures; nothing when loops are not closed.
  std::optional<std::size_t> closed_loops() const;
  std::vector<loop_closure::ClosedLoop> loops() const;
  /// Rejected keyframes and held-out images by reason.
  std::map<std::string, std::size_t> rejected() const;

 private:
  void run_guarded(const std::function<void()>& work);
  void make_loop_closer();
  void process(const localization::MapFrame& frame);
  LoopClosureMethod loop_closure_method(const localization::MapFrame& frame) const;
  void change_scale(const ScaleChange& change);
  mapping::KeyframeDecision add_frame(const localization::MapFrame& frame);
  mapping::MapperInput to_input(const localization::MapFrame& frame);
  torch::Tensor camera_pose(const SE3& T_world_body) const;
  cv::Mat own_mask(const localization::MapFrame& frame) const;
  void close_loops(const localization::MapFrame& frame, const cv::Mat& undistorted);
  void correct(const std::vector<loop_closure::KeyframeCorrections>& all);
  void follow_graph(const localization::MapFrame& frame);
  void optimize();
  void optimize_outage(const localization::MapFrame& frame);
  double step();
  void finish_map();
  void flush_depth();
  std::size_t queued_frames() const;
  double depth_s() const;

  AsyncMapperOptions options_;
  AsyncMapperCallbacks callbacks_;
  Undistorter undistort_;
  cv::Mat mask_;  // of the camera
  SE3 T_rig_body_camera_;
  SE3 T_body_camera_;        // as calibrated so far
  mutable FairMutex mutex_;  // of mapper_, against snapshot and render
  mapping::Mapper mapper_;
  MappingScheduler scheduler_;
  std::optional<loop_closure::AsyncLoopCloser> loop_closer_;  // without a graph of localization
  std::shared_ptr<loop_closure::CorrectionLog> corrections_;
  std::optional<Stamp> graph_begin_;  // first keyframe of the graph of localization
  std::vector<Stamp> before_graph_;   // images before it
  Profiler times_;
  std::optional<Stamp> first_frame_;
  std::optional<Stamp> failing_since_;  // VIO has failed; no steps yet for the time since then
  double outages_s_ = 0.0;
  std::size_t dropped_ = 0;
  std::exception_ptr failure_;  // of the mapper's thread, until `finish`
  std::atomic<bool> failed_ = false;
  std::atomic<bool> paused_ = false;
  std::atomic<std::int64_t> keyframe_count_ = 0;  // for the status line, from any thread
  std::atomic<std::int64_t> gaussian_count_ = 0;
  std::unique_ptr<Worker<localization::MapFrame>> worker_;  // last: ends before what it uses
};

}  // namespace apvi::slam
