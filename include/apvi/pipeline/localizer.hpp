// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>

#include "apvi/fusion/fuser.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "apvi/pipeline/frame_job.hpp"
#include "apvi/vio/estimator.hpp"

namespace apvi::pipeline {

/// Seconds that the stages took for one frame.
struct FrameTiming {
  double wait_s = 0.0;    ///< from the frame's arrival to its output; real time only
  double decode_s = 0.0;  ///< of the pictures, which a live camera has not
  double track_s = 0.0;   ///< front end
  double solve_s = 0.0;
  double information_s = 0.0;
  double marginalize_s = 0.0;
  double localize_s = 0.0;  ///< all behind the front end
};

/// What is known of a frame when all stages are through with it.
struct FrameOutput {
  Stamp stamp;
  bool dropped = false;  ///< real time: its image was not looked at
  vio::FrameStatistics statistics;
  vio::Result vio;          ///< pose in the world of the output
  std::optional<SE3> dipo;  ///< the same
  fusion::FusionResult fusion;
  FrameTiming timing;

  std::optional<StampedPose> fused() const;
};

/// The last stage: visual-inertial odometry, its judge, fusion, and the freezing of the window.
///
/// The world is that of whichever subsystem started first. When it was VIO, DIPO's poses are moved
/// over once, by the rotation about the vertical and the translation between the two in the first
/// frame that has both.
class Localizer {
 public:
  Localizer(const vio::Config& vio, const fusion::Config& fusion,
            const fusion::FreezeConfig& freeze, const Rig& rig);

  /// `tracked` empty: the image was dropped, the other sensors' data are taken in.
  FrameOutput process(const FrameJob& job, const std::optional<vio::TrackedFrame>& tracked);

  const vio::Window& window() const { return estimator_.window(); }
  const fusion::FreezePolicy& freeze_policy() const { return fuser_.freeze_policy(); }
  /// From the first frame to the first pose of VIO [s]; nothing before.
  std::optional<double> vio_start_s() const { return vio_start_s_; }

 private:
  std::optional<vio::Aid> in_world(const std::optional<vio::Aid>& dipo) const;
  std::optional<SE3> place(const std::optional<vio::Aid>& dipo) const;
  void align(const vio::Aid& dipo, const vio::Result& vio, bool vio_was_first);
  void follow_drift(const fusion::FusionInput& input, const FrameOutput& output);
  void act(fusion::Action action);

  bool tight_;
  bool allow_aid_;
  bool follow_drift_;
  vio::Estimator estimator_;
  fusion::Fuser fuser_;
  std::optional<SE3> T_output_dipo_;
  std::optional<SE3> last_pose_;
  SE3 T_vio_dipo_ = SE3::identity();  // where DIPO's poses were when both last agreed
  std::optional<Stamp> first_frame_;
  std::optional<double> vio_start_s_;
};

}  // namespace apvi::pipeline
