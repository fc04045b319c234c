// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <memory>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/localization/options.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::localization {

class MapSink;
class SensorMonitor;
class Synchronizer;
class VisualPipeline;
struct FrameOutput;
struct PingOutput;

/// The sensors of a run: enabled in the options, described by the rig, and present in the source.
struct ActiveSensors {
  bool dvl = false;
  std::size_t cameras = 0;
};

/// Throws InputError when there is neither a DVL nor a camera.
ActiveSensors select_sensors(const Options& options, const Rig& rig, bool has_images);

/// Receivers of results; those not set are not called.
struct SystemCallbacks {
  /// The fused trajectory: one pose per frame; without a camera, one per ping. From `process`, or
  /// from the last stage's thread when `Options::run` asks for threads.
  std::function<void(const StampedPose&)> pose = {};
  /// Every DVL ping, from `process`.
  std::function<void(const PingOutput&)> ping = {};
  /// Every camera frame, from the same thread as `pose`.
  std::function<void(const FrameOutput&)> frame = {};
  MapSink* map = nullptr;  ///< receives keyframes; the caller calls its `finish`
};

/// Localization as a library: samples in, poses out, no files. `process` and the other functions
/// are called from one thread. An error of a stage's thread is thrown by `process` or `finish`. All
/// errors derive from apvi::Error.
class System {
 public:
  /// Uses the sensors of the rig that the options enable. Throws InputError for contradictory
  /// options, and without a DVL and a camera.
  System(const Options& options, const Rig& rig, SystemCallbacks callbacks);
  System(const Options& options, const Rig& rig, const ActiveSensors& sensors,
         SystemCallbacks callbacks);
  ~System();
  System(const System&) = delete;
  System& operator=(const System&) = delete;

  /// Takes one sample; samples of all sensors in order of time (see io::LiveSequence).
  void process(const SensorEvent& event);
  /// Completes everything taken in. Only `reset` may follow.
  void finish();
  /// Abandons what the threads have not begun.
  void stop();
  /// Discards every sample and every estimate; abandons work in progress.
  void reset();

  const SensorMonitor& sensor_monitor() const;
  const Synchronizer& synchronizer() const;
  /// Nothing without a camera.
  const VisualPipeline* visual() const;

 private:
  struct Stages;

  Options options_;
  Rig rig_;
  ActiveSensors sensors_;
  SystemCallbacks callbacks_;
  std::unique_ptr<Stages> stages_;  // last: its threads end before what they use
};

}  // namespace apvi::localization
