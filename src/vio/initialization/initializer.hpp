// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/geometry/se3.hpp"
#include "apvi/vio/config.hpp"
#include "imu/preintegration.hpp"
#include "imu/propagation.hpp"
#include "vio/window/observation.hpp"

namespace apvi::vio {

/// Input frame of the initializer.
struct InitFrame {
  TrackedFrame tracked;
  std::vector<ImuSample>
      imu;  ///< from the previous frame to this one, including both ends; empty for the first
};

/// The first camera.
struct InitCamera {
  SE3 T_body_camera;
  double focal_px = 0.0;
};

/// Result of an initialization attempt.
enum class InitStatus {
  success,
  too_few_frames,
  too_few_tracks,
  too_little_parallax,
  gyro_bias_not_found,
  ill_conditioned,
  gravity_wrong,
  reprojection_too_large,
  scale_uncertain,
};
std::string_view to_string(InitStatus status);

/// States of all frames; world z along gravity, yaw and position of the first frame zero.
struct InitResult {
  InitStatus status = InitStatus::too_few_frames;
  std::size_t first = 0;  ///< first frame used; states of older frames are propagated inertially
  std::vector<imu::NavState> states;
  double reprojection_rms_px = 0.0;
  double scale_sigma = 0.0;  ///< relative, from the final information matrix
  std::string detail;        ///< the value that decided, for the status line
};

/// Visual-inertial initialization without other sensors, for a vehicle in motion: gyro bias from
/// the rotation between frames; velocity, gravity and structure in closed form; refinement with
/// noise-free IMU; full refinement with IMU noise; acceptance tests. Pass the frames of the last
/// few seconds at each new frame until it succeeds; the longest span with enough common tracks is
/// used.
InitResult initialize(const std::vector<InitFrame>& frames, const InitCamera& camera,
                      const imu::Noise& noise, double gravity_magnitude, const InitConfig& config);

}  // namespace apvi::vio
