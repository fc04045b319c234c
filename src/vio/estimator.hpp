// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "apvi/vio/config.hpp"
#include "core/condition_timer.hpp"
#include "imu/sample_buffer.hpp"
#include "vio/result.hpp"
#include "vio/state_prior.hpp"
#include "vio/window/calibration_hold.hpp"
#include "vio/window/window.hpp"

namespace apvi::vio {

/// Sliding-window visual-inertial odometry (mostly as Qin, Li, Shen, "VINS-Mono", T-RO 2018),
/// optionally with DVL and pressure depth in the same graph. Add inertial samples first: a frame is
/// processed once they cover its stamp. World z as given by the rig, gravity along it; with a state
/// prior the world frame is that of the prior, otherwise yaw and position start at zero.
class Estimator {
 public:
  Estimator(const Config& config, const Rig& rig);
  Estimator(const Estimator&) = delete;  // window_.prior points into the window
  Estimator& operator=(const Estimator&) = delete;

  void add(const ImuSample& sample);
  void add(const DvlMeasurement& measurement);
  void add(const PressureDepthMeasurement& measurement);

  /// Processes one frame. Pass the state prior if available; it initializes the window. Without it,
  /// the window is initialized with its newest frame at the position and heading of `start_pose`,
  /// or with its first frame at the origin.
  Result process(const TrackedFrame& tracked, const std::optional<StatePrior>& prior,
                 const std::optional<SE3>& start_pose = std::nullopt);

  /// Resets everything except the buffered sensor samples.
  void reset();

  /// Moves the origin of the world: adds `offset` to every position [m].
  void shift(const Eigen::Vector3d& offset);

  /// Freezes the window as in the paper: its frames and landmarks are held fixed, and new frames
  /// take their poses from the state prior until `release`. With DVL and depth in the graph the
  /// window keeps running instead, and frames with few tracks are excluded from the visual terms.
  void freeze();
  /// Releases the window: frozen frames are removed without marginalization, and the window
  /// continues from the first frame since the freeze, at the pose of its state prior.
  void release();
  /// Releases the window as in the paper: frozen frames stay and are optimized again, with the
  /// prior they had before. The prior of a frame since the freeze stays only where no inertial term
  /// links it to the frame before.
  void unfreeze();
  bool frozen() const { return frozen_; }

  bool started() const { return !window_.frames.empty(); }
  /// What self-calibration knows now.
  CalibrationEstimate calibration() const;
  /// The rig with the calibration of the window.
  Rig calibrated_rig() const { return calibrated(rig_, window_.calibration); }
  const Window& window() const { return window_; }

 private:
  Result start_with_prior(const TrackedFrame& tracked, const StatePrior& at_image);
  Result start_alone(const TrackedFrame& tracked, const std::optional<SE3>& start_pose);
  void clear_window();
  /// Joins the prior of a new window's first frame with what is remembered of the calibration.
  std::shared_ptr<const Prior> with_calibration(const std::shared_ptr<const Prior>& prior);
  bool should_restart(const TrackedFrame& tracked) const;
  void insert_start_frames(const std::vector<TrackedFrame>& frames,
                           const std::vector<imu::NavState>& states);
  /// Whether the window was frozen.
  bool end_freeze();
  void shrink_to_size();
  Result track(const TrackedFrame& tracked, const std::optional<StatePrior>& prior);
  void use_prior(const StatePrior& prior);
  void release_calibration(const class Graph& graph);
  void limit_window(const class Graph& graph);

  void estimate(Result& result, int iterations);
  bool append(const TrackedFrame& tracked);
  void drop_newest();
  Frame& push_frame(Stamp image_stamp, const FrameState& state,
                    std::shared_ptr<imu::Preintegration> from_previous);
  void follow_time_offset(Stamp image_stamp);
  /// When the image was taken, as far as known.
  Stamp state_stamp(Stamp image_stamp) const;
  StatePrior at_state_stamp(StatePrior prior, Stamp image_stamp) const;
  imu::NavState at_image_stamp(const FrameState& state, Stamp image_stamp) const;
  std::shared_ptr<imu::Preintegration> preintegrate_from_newest(Stamp to) const;
  std::shared_ptr<imu::Preintegration> preintegrate(Stamp from, Stamp to,
                                                    const FrameState& state) const;
  void refresh_preintegrations();
  bool uses_pings(Stamp stamp) const;
  void attach_measurements();
  void attach(Frame& frame, DvlMeasurement& measured);
  /// Velocity in the DVL frame after a motion from the frame [m/s].
  Eigen::Vector3d predicted_ping(const Frame& frame, const imu::Preintegration& motion,
                                 const Eigen::Vector3d& gyro) const;
  void attach_pressure_depth(Frame& frame);
  std::string divergence_reason(const Result& result);

  Config config_;
  Rig rig_;
  imu::Noise noise_;
  imu::SampleBuffer imu_;
  double max_step_s_ = std::numeric_limits<double>::infinity();  // largest gap between inertial
                                                                 // samples without extra noise
  std::deque<DvlMeasurement> pings_;
  std::deque<PressureDepthMeasurement> depths_;
  std::vector<TrackedFrame> waiting_;  // frames collected for initialization
  int start_attempts_ = 0;
  std::string last_init_failure_;
  Window window_;
  std::vector<CalibrationBlock> calibration_blocks_;  // of the window
  CalibrationMemory calibration_memory_;
  CalibrationHold calibration_hold_;
  double compensated_s_ = 0.0;  // part of the camera's time offset by which frames are dated back
  bool newest_is_keyframe_ = false;
  bool frozen_ = false;
  std::shared_ptr<const Prior> prior_before_freeze_;
  bool vision_failed_ = false;
  bool has_used_landmarks_ = false;  // a landmark has been in the graph since initialization
  bool started_with_prior_ = false;
  std::optional<Stamp> first_ping_;  // first ping in the graph since initialization or release
  ConditionTimer bad_;               // the reprojection error is too large
};

}  // namespace apvi::vio
