// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <memory>

#include "apvi/localization/system.hpp"
#include "localization/active_sensors.hpp"

namespace apvi::localization {

class MapSink;
class SensorMonitor;
class Synchronizer;
class VisualPipeline;
struct FrameOutput;
struct PingOutput;

/// Receivers of results; those not set are not called.
struct PipelineCallbacks {
  std::function<void(const StampedPose&)> pose = {};        ///< see SystemCallbacks
  std::function<void(const ScaleFound&)> scale_found = {};  ///< see SystemCallbacks
  /// Every DVL ping, from `process`.
  std::function<void(const PingOutput&)> ping = {};
  /// Every camera frame, from the same thread as `pose`.
  std::function<void(const FrameOutput&)> frame = {};
  /// See `System::T_map_odom`; every camera frame, from the same thread as `pose`.
  std::function<void(const SE3&)> map_to_odometry = {};
  MapSink* map = nullptr;  ///< receives keyframes; the caller calls its `finish`
};

/// All stages of localization, for the rest of the library; `System` is for its users. Used as
/// `System` is.
class Pipeline {
 public:
  /// Throws InputError for contradictory options.
  Pipeline(const Options& options, const Rig& rig, const ActiveSensors& sensors,
           PipelineCallbacks callbacks);
  ~Pipeline();
  Pipeline(const Pipeline&) = delete;
  Pipeline& operator=(const Pipeline&) = delete;

  void process(const SensorEvent& event);
  void finish();
  /// `Smoother::adjust`, after `finish`.
  void adjust(const std::function<void(int iteration)>& progress = {});
  void stop();
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
  PipelineCallbacks callbacks_;
  std::unique_ptr<Stages> stages_;  // last: its threads end before what they use
};

}  // namespace apvi::localization
