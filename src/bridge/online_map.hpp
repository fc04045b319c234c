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

#include "apvi/bridge/camera_conversion.hpp"
#include "apvi/bridge/mapping_run.hpp"
#include "apvi/bridge/run_config.hpp"
#include "apvi/core/stopwatch.hpp"
#include "apvi/core/timesheet.hpp"
#include "apvi/core/worker.hpp"
#include "apvi/mapping/mapper.hpp"
#include "apvi/pipeline/map_sink.hpp"
#include "loop_thread.hpp"
#include "map_files.hpp"

namespace apvi::bridge {

/// The mapper behind the pipeline: turns frames into tensors and gives it time. In `sequential`
/// mode on the caller's thread; else on one of its own, which in `replay` makes the pipeline wait
/// and in `realtime` works on the map until the next frame comes, and loses the oldest frames when
/// it is behind.
class OnlineMap : public pipeline::MapSink {
 public:
  /// Both must outlive this.
  OnlineMap(const RunConfig& config, const MappingRunOptions& options, const Rig& rig);

  void begin(const Rig& rig) override;
  void take(pipeline::MapFrame frame) override;
  void finish() override;
  std::string status() const override;
  /// Throws what has ended the mapping while localization went on, if anything has; what there was
  /// of the map had been saved then. After `finish`.
  void rethrow_failure() const;

  /// Abandons the frames that wait, so that what there is can be saved.
  void stop();
  /// The final refinement. False when it was interrupted.
  bool refine();
  /// Goes on from the folder's checkpoint, with what `begin` was told.
  void resume();
  /// Everything into the folder: map.ply, medium.json, keyframes.tum, checkpoint.pt.
  void save();
  bool begun() const { return undistort_.has_value(); }

  const mapping::Mapper& mapper() const { return mapper_; }
  /// In optimisation steps [s].
  double training_s() const { return mapper_.times().of("steps"); }
  /// Where the mapper's thread spent its time [s]: that of the mapper, and intake, of which
  /// pictures.
  std::map<std::string, double> times() const;
  std::size_t dropped_keyframes() const { return dropped_; }
  /// How often a place was met again; nothing when nobody looked.
  std::optional<std::size_t> closed_loops() const;
  /// Keyframes that the mapper would not have, and held-out ones, by why.
  std::map<std::string, std::size_t> not_mapped() const;

 private:
  void attempt(const std::function<void()>& work);
  void give_up(std::exception_ptr why);
  void process(const pipeline::MapFrame& frame);
  mapping::Intake take_in(const pipeline::MapFrame& frame);
  mapping::MapperInput to_input(const pipeline::MapFrame& frame);
  torch::Tensor camera_pose(const SE3& T_world_body) const;
  void close_loops(const pipeline::MapFrame& frame, const cv::Mat& picture);
  std::vector<mapping::Relocated> next_relocation();
  void learn();
  void finish_map();
  void fill_end();
  bool in_realtime() const;
  bool in_hurry() const;
  std::size_t frames_waiting() const;
  double busy_s() const { return times_.of("intake") + training_s(); }
  void look_after();
  Trajectory keyframes() const;

  const RunConfig& config_;
  const MappingRunOptions& options_;
  mapping::Mapper mapper_;
  std::optional<Undistorter> undistort_;
  std::optional<LoopThread> loops_;
  SE3 T_body_camera_;
  Stopwatch watch_;
  Stopwatch since_save_;
  std::optional<MapCurve> curve_;  // once there is a folder
  Timesheet times_;
  std::size_t dropped_ = 0;
  std::exception_ptr failure_;  // of the thread that maps, until `finish`
  std::atomic<bool> failed_ = false;
  std::atomic<std::int64_t> shown_keyframes_ = 0;  // for the status line, from any thread
  std::atomic<std::int64_t> shown_gaussians_ = 0;
  Stopwatch since_end_;  // written before ending_ is
  std::atomic<bool> ending_ = false;
  std::unique_ptr<Worker<pipeline::MapFrame>> worker_;  // last: ends before what it uses
};

}  // namespace apvi::bridge
