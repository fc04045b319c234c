// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>

#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "localization/acoustic_odometry.hpp"
#include "localization/fusion_stage.hpp"
#include "localization/map_sink.hpp"

namespace apvi::slam {
class AsyncMapper;
}  // namespace apvi::slam

namespace apvi::runs {

/// Watches a run without changing its results. The calls come from the threads of the run, which
/// wait for them.
class RunObserver {
 public:
  RunObserver() = default;
  RunObserver(const RunObserver&) = delete;
  RunObserver& operator=(const RunObserver&) = delete;
  virtual ~RunObserver() = default;

  /// Before the first sample.
  virtual void begin(const Rig& rig) = 0;
  /// Every sample, before it is processed.
  virtual void sample(const SensorEvent& event) = 0;
  /// Every ping of a run without a camera.
  virtual void ping(const localization::PingOutput& output) = 0;
  virtual void frame(const localization::FrameOutput& output) = 0;
  /// What the mapper receives, after `frame`.
  virtual void image(const localization::MapFrame& frame) = 0;
  /// Between these two, the map may be read, and saved by `save`, from any thread.
  virtual void map_begins(slam::AsyncMapper& mapper, std::function<void()> save) = 0;
  virtual void map_ends() = 0;
  /// After `save`, once the map is in the run folder. `error`: why it is not; else empty.
  virtual void map_saved(const std::string& error) = 0;
};

}  // namespace apvi::runs
