// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apvi/imu/sample_buffer.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/vio/aid.hpp"
#include "apvi/vio/config.hpp"
#include "apvi/vio/window.hpp"

namespace apvi::vio {

enum class Status {
  waiting,   ///< no state yet
  started,   ///< this frame is the first with a state
  tracking,  ///< as it should be
  blind,     ///< no landmark takes part: inertial (and DVL) only
  frozen,    ///< older frames are held, the aid supplies the poses
  lost,      ///< gave up in this frame; starts anew with the next
};
std::string_view to_string(Status status);

/// How a frame went and how sure the window is.
struct Result {
  Stamp stamp;
  Status status = Status::waiting;
  std::string detail = {};  ///< what it waits for, or why it gave up
  imu::NavState state = {};
  /// Of the newest pose with everything else integrated out; tangent [rotation, position].
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
  /// The same with the oldest pose held: of the motion over the window. Zero with one frame.
  Eigen::Matrix<double, 6, 6> window_information = Eigen::Matrix<double, 6, 6>::Zero();
  double window_s = 0.0;  ///< from the oldest frame to this one
  int landmarks = 0;      ///< that took part
  int sightings = 0;
  double reprojection_rms_px = 0.0;  ///< over the newest frame's sightings
  bool keyframe = false;
  double solve_s = 0.0;
  double information_s = 0.0;
  double marginalize_s = 0.0;

  bool has_state() const { return status != Status::waiting && status != Status::lost; }
};

/// Visual-inertial odometry by a sliding window of keyframes (Qin, Li, Shen, "VINS-Mono", T-RO
/// 2018, in its main lines), with DVL and depth in the same graph if asked to. Feed the inertial
/// samples first: a frame is worked on when they cover its stamp. World z as the rig says, gravity
/// along it; with an aid the world is the aid's, else yaw and position start from zero.
class Estimator {
 public:
  Estimator(const Config& config, const Rig& rig);
  Estimator(const Estimator&) = delete;  // the prior points into the window
  Estimator& operator=(const Estimator&) = delete;

  void add(const ImuSample& sample);
  void add(const DvlMeasurement& measurement);
  void add(const DepthMeasurement& measurement);

  /// One frame. Give the aid when there is one; a start leans on it. A start without an aid has its
  /// newest frame at `place`, as far as heading and position go; without a place its first frame
  /// is where the world begins.
  Result process(const TrackedFrame& tracked, const std::optional<Aid>& aid,
                 const std::optional<SE3>& place = std::nullopt);

  /// Forgets everything but the sensors' samples.
  void reset();

  /// The paper's window freezing: frames that are in the window and the points they saw first are
  /// held as they are, and new frames lean on the aid, until `release`. With DVL and depth in the
  /// graph the window goes on by itself, and frames that follow few corners do not count.
  void freeze();
  /// What was held leaves, without entering the prior; the frames since go on, from where the aid
  /// put the first of them.
  void release();
  bool frozen() const { return frozen_; }

  bool started() const { return !window_.frames.empty(); }
  const Window& window() const { return window_; }

 private:
  Result start_with_aid(const TrackedFrame& tracked, const Aid& aid);
  Result start_alone(const TrackedFrame& tracked, const std::optional<SE3>& place);
  bool starts_anew(const TrackedFrame& tracked) const;
  void adopt(const std::vector<TrackedFrame>& frames, const std::vector<imu::NavState>& states);
  Result track(const TrackedFrame& tracked, const std::optional<Aid>& aid);
  void lean_on(const Aid& aid);
  void make_room(const class Graph& graph);

  void estimate(Result& result, int iterations);
  bool append(const TrackedFrame& tracked);
  void drop_newest();
  Frame& push_frame(Stamp stamp, const FrameState& state,
                    std::shared_ptr<imu::Preintegration> from_previous);
  std::shared_ptr<imu::Preintegration> preintegrate_from_newest(Stamp to) const;
  std::shared_ptr<imu::Preintegration> preintegrate(Stamp from, Stamp to,
                                                    const FrameState& state) const;
  void refresh_preintegrations();
  bool takes_pings(Stamp stamp) const;
  void attach_measurements();
  void attach(Frame& frame, const DvlMeasurement& measured);
  void attach_depth(Frame& frame);
  std::string why_diverged(const Result& result);

  Config config_;
  Rig rig_;
  imu::Noise noise_;
  imu::SampleBuffer imu_;
  double longest_step_s_ = std::numeric_limits<double>::infinity();  // between two samples
  std::deque<DvlMeasurement> pings_;
  std::deque<DepthMeasurement> depths_;
  std::vector<TrackedFrame> waiting_;  // frames before the start
  int start_attempts_ = 0;
  std::string refusal_;  // of the last attempt
  Window window_;
  bool newest_is_keyframe_ = false;
  bool frozen_ = false;
  bool in_doubt_ = false;
  bool has_seen_ = false;            // a landmark has taken part since the start
  bool aided_ = false;               // since a start with an aid
  std::optional<Stamp> first_ping_;  // in the graph since a start or a release
  int bad_frames_ = 0;
};

}  // namespace apvi::vio
