// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/geometry/se3.hpp"

namespace apvi::live {

/// What is known about the vehicle at a stamp of the host's clock.
struct PoseOutput {
  Stamp stamp;
  SE3 T_world_body;
  std::optional<Eigen::Vector3d> v_body;  ///< over ground [m/s]
  /// Of the errors of rotation (in the body frame), then position (in the world) [rad², rad m, m²].
  std::optional<Eigen::Matrix<double, 6, 6>> covariance;
  unsigned resets = 0;   ///< how often the pose has jumped
  bool trusted = false;  ///< by the failure detection; nothing is sent without
};

/// Takes poses; never waits and never throws after its construction.
class PoseSink {
 public:
  virtual ~PoseSink() = default;
  virtual void write(const PoseOutput& pose) = 0;
};

/// "tum:PATH": lines of a TUM trajectory, into a file or a named pipe. "udp://HOST:PORT": JSON
/// lines. "mavlink://udp:HOST:PORT": ODOMETRY and VISION_POSITION_DELTA. `world_is_up`: z of the
/// world is up, not down. Throws InputError for another text, RunError when it cannot be opened.
std::unique_ptr<PoseSink> make_pose_sink(const std::string& text, bool world_is_up);

/// The outputs of a run: drops poses that are not trusted, and those above the highest rate.
class PoseOutputs {
 public:
  /// `max_rate_hz` 0: no limit. Throws as make_pose_sink.
  PoseOutputs(const std::vector<std::string>& outputs, double max_rate_hz, bool world_is_up);

  void write(const PoseOutput& pose);

 private:
  std::vector<std::unique_ptr<PoseSink>> sinks_;
  double period_s_;
  std::optional<Stamp> last_;
};

/// One JSON object with a line break: stamp_ns, position [m], quaternion (wxyz), velocity_body
/// [m/s] if known, covariance (6 rows of 6) if known, reset_counter, trusted.
std::string pose_json(const PoseOutput& pose);

}  // namespace apvi::live
