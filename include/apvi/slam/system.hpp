// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "apvi/slam/options.hpp"

namespace apvi::slam {

/// The water: J exp(-beta_d z) + b_inf (1 - exp(-beta_b z)) per color channel (RGB), z the range.
struct MediumCoefficients {
  std::array<double, 3> beta_d{};  ///< attenuation [1/m]
  std::array<double, 3> beta_b{};  ///< backscatter [1/m]
  std::array<double, 3> b_inf{};   ///< veiling light
};

/// A copy of the map, in the world frame of the trajectory; float arrays row by row.
struct MapSnapshot {
  std::int64_t iteration = 0;
  std::size_t count = 0;                   ///< number of Gaussians, n
  std::vector<float> means;                ///< [n,3] [m]
  std::vector<float> log_scales;           ///< [n,3] natural logarithm of the sigmas [m]
  std::vector<float> quaternions;          ///< [n,4] w x y z, not normalized
  std::vector<float> logit_opacities;      ///< [n]
  std::size_t sh_coefficients = 0;         ///< k: 1, 4, 9 or 16 a channel
  std::vector<float> spherical_harmonics;  ///< [n,k,3] RGB, degree 0 first
  std::optional<MediumCoefficients> medium;
  Trajectory keyframes;  ///< body poses, corrected by loop closures
};

/// A pinhole camera to render from; the center of the top-left pixel is (0, 0).
struct RenderView {
  CameraModel::Parameters camera;  ///< without distortion
  SE3 T_world_camera;              ///< looks along z, x right, y down
};

/// Rendered from one view; all arrays row by row.
struct RenderedImages {
  int width = 0;
  int height = 0;
  std::vector<float> color;     ///< [h,w,3] RGB with the medium
  std::vector<float> restored;  ///< [h,w,3] RGB without the medium
  std::vector<float> depth;     ///< [h,w] along the optical axis [m], 0 where empty
  std::vector<float> alpha;     ///< [h,w] accumulated opacity
};

struct Status {
  std::size_t poses = 0;
  std::size_t keyframes = 0;
  std::size_t gaussians = 0;
  /// Why mapping is disabled; empty while it works. Localization continues.
  std::string mapping_error;
};

/// Receivers of results; those not set are not called.
struct SystemCallbacks {
  /// The fused trajectory, one pose per frame, from whichever thread makes it.
  std::function<void(const StampedPose&)> pose = {};
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

  Trajectory trajectory() const;
  /// The newest pose; nothing before initialization.
  std::optional<StampedPose> pose() const;
  Status status() const;
  /// Nothing before the first keyframe is mapped.
  std::optional<MapSnapshot> map() const;
  /// Nothing before the first keyframe is mapped. Throws InputError for a camera without pixels.
  std::optional<RenderedImages> render(const RenderView& view) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace apvi::slam
