// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/geometry/se3.hpp"
#include "apvi/imu/preintegration.hpp"
#include "apvi/imu/propagation.hpp"
#include "apvi/vio/observation.hpp"

namespace apvi::vio {

/// A frame as an initializer gets it.
struct InitFrame {
  TrackedFrame tracked;
  std::vector<ImuSample>
      imu;  ///< from the frame before to this one, ends included; empty: the first
};

/// Why there is no start yet.
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

/// The states of all frames, world z along gravity, yaw and position of the first frame zero.
struct InitResult {
  InitStatus status = InitStatus::too_few_frames;
  std::size_t first = 0;  ///< older frames took no part, their states are inertial
  std::vector<imu::NavState> states;
  double reprojection_rms_px = 0.0;  ///< of unit focal length times `InitConfig::focal_px`
  double scale_sigma = 0.0;          ///< relative, from the final information
  std::string detail;                ///< the number that decided, for the status line
};

struct InitConfig {
  int min_frames = 8;
  int min_tracks = 30;            ///< common to first and last frame
  double min_parallax_px = 10.0;  ///< median over tracks, rotation taken out
  double max_reprojection_px = 2.0;
  double max_scale_sigma = 0.05;
  double focal_px = 460.0;  ///< turns angles into pixels
  double pixel_sigma = 1.5;
  double min_window_s = 0.4;
  double max_window_s = 3.0;
  int keyframes = 8;
  double gyro_bias_sigma = 0.1;
  double accel_bias_sigma = 0.2;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("min_frames", min_frames, Range{3, 100}, "frames in a start at least");
    v("min_tracks", min_tracks, Range{8, 1000}, "tracks common to its first and last frame");
    v("min_parallax_px", min_parallax_px, Range{0.0, 1000.0},
      "median parallax between the first and whichever frame shows most, rotation taken out [px]");
    v("max_reprojection_px", max_reprojection_px, Range{0.1, 100.0},
      "a start with a larger root mean square is refused [px]");
    v("max_scale_sigma", max_scale_sigma, Range{1e-4, 10.0},
      "a start whose scale is less certain is refused, for a span of a second; from two seconds on "
      "twice that (one sigma, relative)");
    v("focal_px", focal_px, Range{1.0, 1e5},
      "focal length that angles are turned into pixels with");
    v("pixel_sigma", pixel_sigma, Range{0.01, 100.0},
      "of a corner, what its track drifts over the span included [px]");
    v("min_window_s", min_window_s, Range{0.05, 60.0}, "a start is made from no less [s]");
    v("max_window_s", max_window_s, Range{0.1, 60.0}, "older frames take no part [s]");
    v("keyframes", keyframes, Range{3, 100}, "of its frames that are solved for");
    v("gyro_bias_sigma", gyro_bias_sigma, Range{1e-6, 10.0}, "of the gyro's turn-on bias [rad/s]");
    v("accel_bias_sigma", accel_bias_sigma, Range{1e-6, 10.0},
      "of the accelerometer's turn-on bias [m/s²]");
  }
};

/// Visual-inertial start without other sensors and without rest: gyro bias from the rotation
/// between the frames, then velocity, gravity and structure in closed form, then a solve that takes
/// the IMU for exact, then one that weighs its noise, then a decision by numbers. Give it the
/// frames of the last few seconds, each time there is a new one, until it succeeds; it uses the
/// longest span of them with enough tracks in common.
InitResult initialize(const std::vector<InitFrame>& frames, const SE3& T_body_camera,
                      const imu::Noise& noise, double gravity_magnitude, const InitConfig& config);

}  // namespace apvi::vio
