// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string_view>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/localization/system.hpp"
#include "fusion/fuser.hpp"
#include "localization/active_sensors.hpp"
#include "localization/frame_job.hpp"
#include "localization/scale_finder.hpp"
#include "vio/estimator.hpp"
#include "vio/visual/visual_odometry.hpp"

namespace apvi::localization {

/// Processing times of one frame [s].
struct FrameTiming {
  double decode_s = 0.0;  ///< image decoding; zero for a live camera
  double track_s = 0.0;   ///< front end
  double solve_s = 0.0;
  double information_s = 0.0;
  double marginalize_s = 0.0;
  double localize_s = 0.0;  ///< total after the front end
};

/// Result of all stages for one frame.
struct FrameOutput {
  Stamp stamp;
  bool dropped = false;  ///< real time: its image was skipped
  vio::FrameStatistics statistics;
  vio::Result vio;          ///< pose in the output frame
  std::optional<SE3> dipo;  ///< pose in the output frame
  fusion::FusionResult fusion;
  bool begins_segment = false;  ///< the first pose after a pause of the inertial data
  /// Part of the covariance of the fused pose: the error that all poses of its segment share.
  fusion::Matrix6 segment_covariance = fusion::Matrix6::Zero();
  std::optional<ScaleFound> scale_found;  ///< what this frame changes about earlier poses
  FrameTiming timing;

  std::optional<StampedPose> fused() const;
  /// Whether the fused pose is by images alone, in an unknown unit.
  bool is_up_to_scale() const;
  /// Where the fused pose is from: `up_to_scale`, or the state of the fusion.
  std::string_view pose_source() const;
};

/// The last stage: visual-inertial odometry, failure detection, fusion, and freezing of the window.
/// Without a DVL, or while it has no bottom lock at the start, odometry by images alone gives poses
/// up to scale until visual-inertial odometry is initialized, and always without an IMU.
///
/// The output frame is the world frame of whichever estimator initialized first. If that was VIO,
/// DIPO's poses are aligned to it once, by the yaw and translation between the two at the first
/// frame that has both.
class FusionStage {
 public:
  /// A gap in the inertial data of more than `segment_gap_s` begins a new segment.
  FusionStage(const vio::Config& vio, const fusion::Config& fusion,
              const fusion::FreezeConfig& freeze, const Rig& rig, const ActiveSensors& sensors,
              double segment_gap_s = dipo::InertialConfig{}.segment_gap_s);

  /// `tracked` empty: the image was dropped; the other sensors' data are still processed.
  FrameOutput process(const FrameJob& job, const std::optional<vio::TrackedFrame>& tracked);

  /// Of the estimator that gave the last pose.
  const vio::Window& window() const {
    return images_alone_ && images_alone_->started() ? images_alone_->window()
                                                     : estimator_.window();
  }
  const vio::Estimator& estimator() const { return estimator_; }
  const fusion::FreezePolicy& freeze_policy() const { return fuser_.freeze_policy(); }
  /// Time from the first frame to the first VIO pose [s]; empty before.
  std::optional<double> vio_init_time_s() const { return vio_init_time_s_; }

 private:
  void add(const ImuSample& sample);
  void use_images_alone(const vio::TrackedFrame& tracked, FrameOutput& output);
  void hand_over(FrameOutput& output);
  std::optional<vio::StatePrior> acoustic_prior(const FrameJob& job);
  bool images_may_serve(const FrameJob& job, bool with_dipo) const;
  void use_scale(const ScaleFound& found, vio::Result& vio);
  void add_segment_error(FrameOutput& output);
  std::optional<vio::StatePrior> to_output_frame(const std::optional<vio::StatePrior>& dipo) const;
  std::optional<SE3> restart_pose(const std::optional<vio::StatePrior>& dipo) const;
  void align_dipo(const vio::StatePrior& dipo, const vio::Result& vio, bool vio_was_first);
  void update_vio_dipo_transform(const fusion::FusionInput& input, const FrameOutput& output);
  void apply(fusion::Action action);

  bool tight_;
  bool allow_state_prior_;
  bool track_drift_;
  bool unfreeze_;
  vio::Estimator estimator_;
  std::optional<vio::VisualOdometry> images_alone_;
  fusion::Fuser fuser_;
  std::optional<SE3> T_output_dipo_;
  std::optional<fusion::PoseEstimate> last_pose_;  // fused
  Stamp last_pose_stamp_;
  SE3 T_vio_dipo_ = SE3::identity();  // updated while the two agree
  double segment_gap_s_;
  bool with_dvl_;
  Eigen::Vector3d p_body_camera_;
  ScaleFinder scale_finder_;
  bool height_is_measured_;
  bool align_pending_ = true;              // the segment has no pose of DIPO yet
  bool segment_began_ = false;             // after a gap, and has no pose yet
  dipo::SegmentError segment_error_;       // of the poses of the current one
  std::optional<Stamp> dipo_waits_since_;  // for the scale of images alone
  std::optional<Stamp> last_imu_;
  std::optional<Stamp> first_frame_;
  std::optional<double> vio_init_time_s_;
};

}  // namespace apvi::localization
