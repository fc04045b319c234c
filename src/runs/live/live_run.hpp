// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>

#include "live/latency.hpp"
#include "live/pose_output.hpp"
#include "live/recorder.hpp"
#include "live/session.hpp"
#include "runs/live/live_hooks.hpp"
#include "runs/live/live_poses.hpp"
#include "runs/run_config.hpp"

namespace apvi::runs {

inline constexpr const char* kRecordingFolder = "recording";  ///< in a run folder

/// What a run on live sources has besides the run itself: sources, recording, outputs, latency.
///
///     LiveRun live(config, folder, interrupted);
///     runs::run(live.config(), live.sequence(), {..., .live = &live.hooks()});
///     live.finish();
class LiveRun {
 public:
  /// Opens sources and outputs of `config.live`. Throws InputError for a bad address, without a
  /// source, or without a rig; RunError when the recording cannot be created.
  LiveRun(const RunConfig& config, std::filesystem::path folder, std::function<bool()> interrupted);

  /// The configuration to run with: real time, with the sensors that the sources have; `dataset` is
  /// the recording, so that `apvi run RUN/resolved.yaml` repeats the run.
  const RunConfig& config() const { return config_; }
  io::SequenceReader& sequence() { return session_->sequence(); }
  const LiveHooks& hooks() const { return hooks_; }
  /// Ends the sources and the recording and adds the section `live` to metrics.json.
  void finish();

 private:
  void publish(const live::PoseOutput& pose);
  std::string status() const;

  RunConfig config_;
  std::filesystem::path folder_;
  std::optional<live::Recorder> recorder_;
  live::LatencyMonitor latency_;
  std::optional<live::PoseOutputs> outputs_;
  LivePoses poses_;
  LiveHooks hooks_;
  std::unique_ptr<live::Session> session_;  // last: its threads use the others
};

}  // namespace apvi::runs
