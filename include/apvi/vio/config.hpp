// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "apvi/config/fields.hpp"
#include "apvi/core/constants.hpp"

namespace apvi::vio {

/// Front end.
struct TrackerConfig {
  int max_tracks = 150;
  std::optional<double> min_distance_px;
  int max_image_side_px = 1280;
  double stable_s = 0.4;
  int stable_frames = 2;
  bool equalize = true;
  double max_forward_backward_px = 0.5;
  double max_epipolar_px = 1.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("max_tracks", max_tracks, Range{10, 2000}, "maximum number of tracked corners");
    v("min_distance_px", min_distance_px, Range{1.0, 500.0},
      "minimum distance between corners; null: by the size of the image, 25 px at 640x480 [px]");
    v("max_image_side_px", max_image_side_px, Range{160, 100000},
      "images with a longer side are tracked at the largest whole fraction of their size that "
      "fits; "
      "lengths in pixels refer to the tracked image [px]");
    v("stable_s", stable_s, Range{0.0, 60.0}, "a track is stable from this age on [s]");
    v("stable_frames", stable_frames, Range{2, 1000},
      "a stable track has also been seen in this many consecutive frames (the paper: 10, and no "
      "minimum age)");
    v("equalize", equalize, "equalize the contrast (CLAHE) before corner detection");
    v("max_forward_backward_px", max_forward_backward_px, Range{0.01, 100.0},
      "maximum forward-backward error of optical flow [px]");
    v("max_epipolar_px", max_epipolar_px, Range{0.01, 100.0},
      "maximum distance to the epipolar line (essential-matrix RANSAC) [px]");
  }
};

/// Initialization without a DVL.
struct InitConfig {
  int min_frames = 8;
  int min_tracks = 30;             ///< common to first and last frame
  double min_parallax_deg = 1.25;  ///< median over tracks, rotation removed
  double max_reprojection_px = 2.0;
  double max_scale_sigma = 0.05;
  double pixel_sigma = 1.5;
  double min_window_s = 0.4;
  double max_window_s = 3.0;
  int keyframes = 8;
  double gyro_bias_sigma = 0.1;
  double accel_bias_sigma = 0.2;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("min_frames", min_frames, Range{3, 100}, "minimum number of frames");
    v("min_tracks", min_tracks, Range{8, 1000},
      "minimum tracks common to the first and last frame");
    v("min_parallax_deg", min_parallax_deg, Range{0.0, 90.0},
      "minimum of the largest median parallax to the first frame, rotation compensated [deg]");
    v("max_reprojection_px", max_reprojection_px, Range{0.1, 100.0},
      "maximum RMS reprojection error [px]");
    v("max_scale_sigma", max_scale_sigma, Range{1e-4, 10.0},
      "maximum relative scale uncertainty, one sigma, for windows up to one second; twice that "
      "from two seconds on");
    v("pixel_sigma", pixel_sigma, Range{0.01, 100.0},
      "standard deviation of a corner, including track drift over the window [px]");
    v("min_window_s", min_window_s, Range{0.05, 60.0}, "minimum window length [s]");
    v("max_window_s", max_window_s, Range{0.1, 60.0},
      "maximum window length; older frames are ignored [s]");
    v("keyframes", keyframes, Range{3, 100}, "number of frames that are optimized");
    v("gyro_bias_sigma", gyro_bias_sigma, Range{1e-6, 10.0},
      "prior on the gyro bias in this solve, one sigma [rad/s]");
    v("accel_bias_sigma", accel_bias_sigma, Range{1e-6, 10.0},
      "prior on the accelerometer bias in this solve, one sigma [m/s²]");
  }
};

/// Sensors in the factor graph: camera and IMU as in the paper, or DVL and pressure as well.
enum class GraphKind { paper, tight };

/// Handling of a landmark that is still tracked when its anchor frame leaves the window: it is
/// marginalized with the frame and starts anew; it is re-anchored in its next frame and the
/// observations of the old frame are lost; or both, which counts the remaining observations twice
/// (as VINS does).
enum class ContinuingTracks { marginalize, reanchor, reuse };

struct WindowConfig {
  ContinuingTracks continuing_tracks = ContinuingTracks::marginalize;
  int keyframes = 10;
  double keyframe_parallax_deg = 5.0;
  double keyframe_min_tracked_ratio = 0.6;
  double keyframe_max_interval_s = 0.5;
  int max_iterations = 4;
  double max_solve_s = 0.03;
  bool square_root_marginalization = false;
  bool first_estimate_jacobians = true;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("continuing_tracks", continuing_tracks,
      config::Choices<ContinuingTracks>{{"marginalize", ContinuingTracks::marginalize},
                                        {"reanchor", ContinuingTracks::reanchor},
                                        {"reuse", ContinuingTracks::reuse}},
      "landmarks still tracked when their anchor frame leaves the window: marginalize them; "
      "reanchor them, losing the anchor's observations; or reuse their observations (double "
      "counting)");
    v("keyframes", keyframes, Range{3, 50},
      "number of keyframes in the window, besides the newest frame");
    v("keyframe_parallax_deg", keyframe_parallax_deg, Range{0.01, 90.0},
      "new keyframe at this mean motion of the corners since the last one, near the center of the "
      "image [deg]");
    v("keyframe_min_tracked_ratio", keyframe_min_tracked_ratio, Range{0.0, 1.0},
      "new keyframe when fewer than this fraction of the last one's tracks are left");
    v("keyframe_max_interval_s", keyframe_max_interval_s, Range{0.05, 60.0},
      "new keyframe at the latest after this time [s]");
    v("max_iterations", max_iterations, Range{1, 100},
      "maximum Levenberg-Marquardt iterations per frame");
    v("max_solve_s", max_solve_s, Range{0.001, 10.0}, "time limit of a solve in realtime mode [s]");
    v("square_root_marginalization", square_root_marginalization,
      "marginalize by QR of the Jacobian instead of the Schur complement");
    v("first_estimate_jacobians", first_estimate_jacobians,
      "linearize states in the prior at their first estimates");
  }
};

struct VisionConfig {
  double pixel_sigma = 1.0;
  double huber_px = 1.5;
  double max_reprojection_px = 3.0;
  int min_observations = 3;
  double min_parallax_deg = 0.3;
  double short_track_weight = 0.25;
  double long_track_weight = 1.0;
  int short_track_frames = 4;
  int long_track_frames = 10;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("pixel_sigma", pixel_sigma, Range{0.01, 100.0},
      "standard deviation of the reprojection residual on a long track, including the noise in the "
      "anchor frame [px]");
    v("huber_px", huber_px, Range{0.01, 1000.0},
      "Huber threshold of the reprojection residual [px]");
    v("max_reprojection_px", max_reprojection_px, Range{0.1, 1000.0},
      "landmarks with a larger mean reprojection error are removed; those with more than 1 px also "
      "when it is above three times the median of all [px]");
    v("min_observations", min_observations, Range{2, 50},
      "minimum observations of a landmark in the graph");
    v("min_parallax_deg", min_parallax_deg, Range{0.0, 90.0},
      "minimum angle between rays for triangulation [deg]");
    v("short_track_weight", short_track_weight, Range{0.0, 1.0},
      "weight of an observation on a track of short_track_frames: the paper's beta");
    v("long_track_weight", long_track_weight, Range{0.0, 10.0},
      "weight of an observation on a track of long_track_frames: the paper's alpha + beta");
    v("short_track_frames", short_track_frames, Range{1, 1000},
      "length of a short track: the paper's n_min [frames]");
    v("long_track_frames", long_track_frames, Range{2, 1000},
      "length of a long track: the paper's n_max [frames]");
  }
};

/// A calibration parameter: estimated in the window, or fixed at the value of the rig.
struct CalibrationPrior {
  bool estimate = true;
  double sigma = 0.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("estimate", estimate, "estimate in the window, starting from the rig's value");
    v("sigma", sigma, Range{1e-9, 100.0}, "uncertainty of the rig's value, one sigma");
  }
};

/// Self-calibration. The uncertainties are those of a careful calibration by hand.
struct CalibrationConfig {
  CalibrationPrior camera_mounting{.estimate = true, .sigma = 0.02};
  CalibrationPrior camera_lever_arm{.estimate = true, .sigma = 0.03};
  CalibrationPrior camera_time_offset{.estimate = true, .sigma = 0.05};
  CalibrationPrior focal_length{.estimate = true, .sigma = 0.01};
  CalibrationPrior principal_point{.estimate = true, .sigma = 0.005};
  CalibrationPrior dvl_mounting{.estimate = true, .sigma = 0.02};
  CalibrationPrior dvl_lever_arm{.estimate = true, .sigma = 0.03};
  CalibrationPrior dvl_scale{.estimate = true, .sigma = 0.01};
  /// A parameter is held at the rig's value until the measurements contradict that value by more.
  double release_sigmas = 4.0;

  template <typename V>
  void visit(V& v) {
    v("camera_mounting", camera_mounting, "rotation of the cameras in the body frame [rad]");
    v("camera_lever_arm", camera_lever_arm, "position of the cameras in the body frame [m]");
    v("camera_time_offset", camera_time_offset, "how late the image stamps are [s]");
    v("focal_length", focal_length, "relative error of the focal lengths");
    v("principal_point", principal_point, "principal points [focal lengths]");
    v("dvl_mounting", dvl_mounting, "rotation of the DVL in the body frame [rad]");
    v("dvl_lever_arm", dvl_lever_arm, "position of the DVL in the body frame [m]");
    v("dvl_scale", dvl_scale, "relative error of the DVL's velocity, as of the speed of sound");
    v("release_sigmas", release_sigmas, config::Range{0.0, 1e6},
      "a parameter is held at the rig's value until the measurements contradict that value by more "
      "than this many standard deviations; 0: estimated from the start");
  }
  /// Nothing is estimated.
  static CalibrationConfig fixed() {
    CalibrationConfig none;
    for (CalibrationPrior* prior :
         {&none.camera_mounting, &none.camera_lever_arm, &none.camera_time_offset,
          &none.focal_length, &none.principal_point, &none.dvl_mounting, &none.dvl_lever_arm,
          &none.dvl_scale}) {
      prior->estimate = false;
    }
    return none;
  }
};

struct StartConfig {
  double gauge_sigma = 1e-3;
  double gyro_bias_sigma = 0.05;
  double accel_bias_sigma = 0.1;
  double lookback_s = 3.0;
  double dvl_aiding_s = 3.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("gauge_sigma", gauge_sigma, Range{1e-6, 1.0},
      "prior on the unobservable yaw [rad] and position [m] of the first frame, one sigma");
    v("gyro_bias_sigma", gyro_bias_sigma, Range{1e-6, 1.0},
      "prior on the gyro bias in the window after initialization without a DVL, one sigma [rad/s]");
    v("accel_bias_sigma", accel_bias_sigma, Range{1e-6, 10.0},
      "prior on the accelerometer bias in the window after initialization without a DVL, one sigma "
      "[m/s²]");
    v("lookback_s", lookback_s, Range{0.2, 60.0},
      "frames older than this are not used to initialize without a DVL [s]");
    v("dvl_aiding_s", dvl_aiding_s, Range{0.0, 60.0},
      "DVL velocity factors are in the graph for this long after initialization or a freeze, even "
      "with graph: paper, as scale is unobservable at constant velocity; 0: never, nor during a "
      "freeze [s]");
  }
};

struct HealthConfig {
  double max_reprojection_px = 2.5;
  double max_gyro_bias = 0.5;
  double max_accel_bias = 2.0;
  double max_speed = 10.0;
  double max_gyro = 8.7;
  double max_accel = 80.0;
  double max_bad_s = 0.4;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("max_reprojection_px", max_reprojection_px, Range{0.1, 1000.0},
      "a frame with a larger RMS reprojection error is bad [px]");
    v("max_gyro_bias", max_gyro_bias, Range{0.0, 10.0}, "a larger gyro bias is divergence [rad/s]");
    v("max_accel_bias", max_accel_bias, Range{0.0, 100.0},
      "a larger accelerometer bias is divergence [m/s²]");
    v("max_speed", max_speed, Range{0.0, 1000.0}, "a larger speed is divergence [m/s]");
    v("max_gyro", max_gyro, Range{0.1, 100.0},
      "samples with a larger angular rate are rejected as shock or saturation [rad/s]");
    v("max_accel", max_accel, Range{10.0, 1000.0},
      "samples with a larger specific force are rejected as shock or saturation [m/s²]");
    v("max_bad_s", max_bad_s, Range{0.0, 60.0},
      "bad frames without a good one for this long are divergence [s]");
  }
};

struct TightConfig {
  bool use_dvl_velocity = true;
  bool use_depth = true;
  double huber_sigmas = 3.0;
  int recovery_min_tracks = 100;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("recovery_min_tracks", recovery_min_tracks, Range{0, 100000},
      "minimum tracked corners of a frame for recovery after a vision failure");
    v("use_dvl_velocity", use_dvl_velocity, "add a velocity factor per DVL ping");
    v("use_depth", use_depth, "add a depth factor per frame (pressure or depth sensor)");
    v("huber_sigmas", huber_sigmas, Range{0.1, 1000.0}, "Huber threshold of these factors [sigma]");
  }
};

/// Odometry by images alone, up to scale: without an IMU, and until the scale is known.
struct VisualConfig {
  bool enabled = true;
  double start_distance = 2.0;
  double min_parallax_deg = 2.0;
  int min_tracks = 30;
  double lookback_s = 10.0;
  double max_gap_s = 1.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled,
      "estimate poses up to scale from one camera while no other sensor gives the scale");
    v("start_distance", start_distance, Range{1e-3, 1e3},
      "median distance of the first scene, which defines the unknown unit [m]");
    v("min_parallax_deg", min_parallax_deg, Range{0.1, 45.0},
      "minimum median angle between the rays of the two images of the start [deg]");
    v("min_tracks", min_tracks, Range{10, 1000}, "minimum tracks common to these images");
    v("lookback_s", lookback_s, Range{0.2, 60.0},
      "frames older than this when the start succeeds get no pose [s]");
    v("max_gap_s", max_gap_s, Range{0.05, 60.0},
      "odometry by images alone starts anew after this time without a pose [s]");
  }
};

/// The `vio` section: visual-inertial odometry.
struct Config {
  GraphKind graph = GraphKind::tight;
  bool stereo = true;
  TrackerConfig tracker;
  WindowConfig window;
  VisionConfig vision;
  TightConfig tight;
  CalibrationConfig calibration;
  StartConfig initialization;
  InitConfig initialization_without_dvl;
  VisualConfig visual;
  HealthConfig health;
  double gyro_noise_factor = 1.0;
  double accel_noise_factor = 1.0;
  double gravity = kStandardGravity;  ///< [m/s²]; the key is `localization.gravity`

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("graph", graph,
      config::Choices<GraphKind>{{"paper", GraphKind::paper}, {"tight", GraphKind::tight}},
      "measurements in the factor graph: paper: camera and IMU; tight: DVL and pressure too");
    v("stereo", stereo, "use the second camera if the rig has one");
    v("tracker", tracker, "front end");
    v("window", window, "sliding window");
    v("vision", vision, "visual measurements");
    v("tight", tight, "additional factors with graph: tight");
    v("calibration", calibration, "self-calibration in the window");
    v("initialization", initialization, "window initialization");
    v("initialization_without_dvl", initialization_without_dvl,
      "visual-inertial initialization without a DVL");
    v("visual", visual, "odometry by images alone");
    v("health", health, "divergence detection");
    v("gyro_noise_factor", gyro_noise_factor, Range{0.1, 1000.0},
      "multiplies the rig's gyro noise density");
    v("accel_noise_factor", accel_noise_factor, Range{0.1, 1000.0},
      "multiplies the rig's accelerometer noise density");
  }
};

}  // namespace apvi::vio
