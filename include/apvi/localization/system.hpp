// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "apvi/geometry/scale_change.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "apvi/localization/options.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::localization {

/// What shows the scale of poses by images alone.
enum class ScaleSensor { imu, dvl, pressure };

/// The scale of poses by images alone has become known. Earlier poses, from the stamp `since` on,
/// and everything made with them must be changed.
struct ScaleFound {
  Stamp since;
  ScaleChange to_meters;  ///< of positions of the camera and of what it sees
  Eigen::Vector3d p_body_camera = Eigen::Vector3d::Zero();  ///< [m]
  ScaleSensor by = ScaleSensor::imu;
};
/// Changes the poses of the body.
void apply(const ScaleFound& found, Trajectory& poses);

/// Receivers of results; those not set are not called.
struct SystemCallbacks {
  /// The fused trajectory: one pose per frame; without a camera, one per ping. From `process`, or
  /// from the last stage's thread when `Options::run` asks for threads. When an initialization
  /// without a DVL succeeds, poses of earlier frames follow; they replace those of equal stamps.
  std::function<void(const StampedPose&)> pose = {};
  /// Without a DVL, the first poses may be up to scale; called once, before the first metric pose.
  std::function<void(const ScaleFound&)> scale_found = {};
};

/// Localization as a library: samples in, poses out, no files. `pose` and `trajectory` may be
/// called from any thread at any time, the others from one thread. An error of a stage's thread is
/// thrown by `process` or `finish`. All errors derive from apvi::Error.
class System {
 public:
  /// Uses the sensors of the rig that the options enable. Throws InputError for contradictory
  /// options, and without a camera or a DVL with an IMU.
  System(const Options& options, const Rig& rig, SystemCallbacks callbacks = {});
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

  /// The fused trajectory so far: poses of the body in the odometry frame.
  Trajectory trajectory() const;
  /// The newest pose; nullopt before initialization.
  std::optional<StampedPose> pose() const;
  /// Where the odometry frame of the poses lies in the frame in which loops are closed (REP 105):
  /// T_map_odom * T_world_body is the newest pose without the drift that loop closures have found.
  /// Identity before the first one, and with `smoothing.enabled: false`.
  SE3 T_map_odom() const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace apvi::localization
