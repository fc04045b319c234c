// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <memory>

#include "apvi/geometry/scale_change.hpp"
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
  bool imu = true;
  bool dvl = false;  ///< never without an IMU
  std::size_t cameras = 0;
};

/// What a source has, besides what the rig describes.
struct RecordedSensors {
  bool images = true;
  bool imu = true;
};

/// Throws InputError when there is neither a DVL with an IMU nor a camera.
ActiveSensors select_sensors(const Options& options, const Rig& rig,
                             const RecordedSensors& recorded);

/// The scale of poses by images alone has become known: earlier poses, from stamp `since` on, and
/// everything made with them are to be changed.
struct ScaleFound {
  Stamp since;
  ScaleChange to_meters;
};

void apply(const ScaleFound& found, Trajectory& poses);

/// Receivers of results; those not set are not called.
struct SystemCallbacks {
  /// The fused trajectory: one pose per frame; without a camera, one per ping. From `process`, or
  /// from the last stage's thread when `Options::run` asks for threads. When an initialization
  /// without a DVL succeeds, poses of earlier frames follow; they replace those of equal stamps.
  std::function<void(const StampedPose&)> pose = {};
  /// Without a DVL, the first poses may be up to scale; called once, before the first metric pose.
  std::function<void(const ScaleFound&)> scale_found = {};
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
