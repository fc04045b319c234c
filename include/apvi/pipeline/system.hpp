// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/pipeline/map_sink.hpp"
#include "apvi/pipeline/navigator.hpp"
#include "apvi/pipeline/run_config.hpp"
#include "apvi/pipeline/sensor_watch.hpp"
#include "apvi/pipeline/visual_pipeline.hpp"

namespace apvi::pipeline {

/// The sensors of a run as they are: asked for, and there.
struct Sensors {
  bool dvl = false;
  std::size_t cameras = 0;
};

/// What the configuration asks for, the rig describes, and the source has. Throws InputError when
/// there is nothing to localize with.
Sensors find_sensors(const RunConfig& config, const Rig& rig, bool has_images);

/// Who is told what. Pings come in `process`; frames, on threads (`run.mode`), from the last
/// stage's; poses with whichever makes them. What is not set is not called.
struct SystemSinks {
  std::function<void(const LocalizationOutput&)> ping = {};
  std::function<void(const FrameOutput&)> frame = {};
  /// The trajectory: one pose a frame; without a camera one a ping.
  std::function<void(const StampedPose&)> pose = {};
  MapSink* map =
      nullptr;  ///< gets what a map is made of; its `begin` and `finish` are the caller's
};

/// Localization as a library: samples in, poses out, no files. `process` and everything below are
/// for one thread. What a stage throws on a thread of its own comes out of `process` or `finish`.
class System {
 public:
  System(const RunConfig& config, const Rig& rig, const Sensors& sensors, SystemSinks sinks);

  void process(const SensorEvent& event);
  /// Soft stop: everything taken in is finished. `reset` is what can follow.
  void finish();
  /// Hard stop: what the threads have not begun is abandoned.
  void stop();
  /// Forgets every sample and every estimate, as if newly made; what is under way is abandoned.
  void reset();

  const SensorWatch& watch() const { return watch_; }
  const Navigator& navigator() const { return *navigator_; }
  const VisualPipeline* visual() const { return visual_ ? &*visual_ : nullptr; }

 private:
  void make_stages();

  RunConfig config_;
  Rig rig_;
  Sensors sensors_;
  SystemSinks sinks_;
  SensorWatch watch_;
  std::optional<Navigator> navigator_;
  std::optional<VisualPipeline> visual_;  // last: its threads end before what they fill
};

}  // namespace apvi::pipeline
