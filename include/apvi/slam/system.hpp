// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/localization/system.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "apvi/slam/map_snapshot.hpp"
#include "apvi/slam/options.hpp"

namespace apvi::slam {

/// How far localization and mapping have come.
struct Status {
  std::size_t poses = 0;      ///< of the fused trajectory
  std::size_t keyframes = 0;  ///< of the map
  std::size_t gaussians = 0;  ///< of the map
  /// Why mapping is disabled; empty while it works. Localization continues.
  std::string mapping_error;
};

/// Receivers of results; those not set are not called.
struct SystemCallbacks {
  /// The fused trajectory, one pose per frame, from whichever thread makes it.
  std::function<void(const StampedPose&)> pose = {};
  /// See localization::SystemCallbacks; the map has the new unit from then on.
  std::function<void(const localization::ScaleFound&)> scale_found = {};
};

/// Localization and mapping as a library: samples in; poses, map snapshots and renders out. No
/// files, no command line.
///
/// `process`, `finish`, `refine` and `stop` are called from one thread; the others from any thread
/// at any time. `Options::localization.run.mode` decides on the threads: `sequential` uses the
/// caller's and gives the same bits in every run; `realtime` never makes the caller wait for the
/// map. A failure of mapping leaves localization running (see Status). All errors derive from
/// apvi::Error.
class System {
 public:
  /// Throws InputError for contradictory options, or a rig without what they need. Without a camera
  /// in the rig there is no map.
  System(const Options& options, const Rig& rig, SystemCallbacks callbacks = {});
  ~System();
  System(const System&) = delete;
  System& operator=(const System&) = delete;

  /// Takes one sample; samples of all sensors in order of time (see io::LiveSequence).
  void process(const SensorEvent& event);
  /// Completes everything taken in.
  void finish();
  /// Optimizes the finished map further, without new keyframes: `mapping.final_iterations` steps.
  void refine();
  /// Abandons what the threads have not begun.
  void stop();

  /// The fused trajectory so far: poses of the body in the odometry frame.
  Trajectory trajectory() const;
  /// The newest pose; nullopt before initialization.
  std::optional<StampedPose> pose() const;
  /// See localization::System. The map has loop corrections of its own.
  SE3 T_map_odom() const;
  Status status() const;
  /// nullopt before the first keyframe is mapped.
  std::optional<MapSnapshot> map() const;
  /// nullopt before the first keyframe is mapped. Throws InputError for a camera without pixels.
  std::optional<RenderedImages> render(const RenderView& view) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace apvi::slam
