// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/config/fields.hpp"
#include "apvi/vio/initializer.hpp"
#include "apvi/vio/tracker.hpp"

namespace apvi::vio {

/// What the factor graph is made of: the paper's (camera and IMU), or with DVL and pressure too.
enum class GraphKind { paper, tight };

/// What becomes of a landmark that is still followed when the frame it is anchored in leaves the
/// window: it leaves too and starts anew; it moves on to its next frame and what the old one saw is
/// forgotten; or both, which counts what the others saw twice (as VINS does).
enum class ContinuingTracks { marginalize, reanchor, reuse };

struct WindowConfig {
  ContinuingTracks continuing_tracks = ContinuingTracks::marginalize;
  int keyframes = 10;
  double keyframe_parallax_px = 20.0;
  double keyframe_survival = 0.6;
  double keyframe_interval_s = 0.5;
  int iterations = 4;
  double max_solve_s = 0.03;
  bool square_root = false;
  bool first_estimates = true;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("continuing_tracks", continuing_tracks,
      config::Choices<ContinuingTracks>{{"marginalize", ContinuingTracks::marginalize},
                                        {"reanchor", ContinuingTracks::reanchor},
                                        {"reuse", ContinuingTracks::reuse}},
      "landmarks that outlive the frame they are anchored in: leave with it; lose what it saw; or "
      "count twice");
    v("keyframes", keyframes, Range{3, 50}, "in the window, besides the newest frame");
    v("keyframe_parallax_px", keyframe_parallax_px, Range{0.1, 1000.0},
      "mean parallax since the last keyframe that makes a new one [px]");
    v("keyframe_survival", keyframe_survival, Range{0.0, 1.0},
      "so does a smaller share of its tracks that live on");
    v("keyframe_interval_s", keyframe_interval_s, Range{0.05, 60.0},
      "and so much time since it [s]");
    v("iterations", iterations, Range{1, 100}, "of Levenberg-Marquardt per frame at most");
    v("max_solve_s", max_solve_s, Range{0.001, 10.0}, "time cap of one solve in real time [s]");
    v("square_root", square_root,
      "marginalize by QR of the Jacobian instead of the Schur complement");
    v("first_estimates", first_estimates,
      "take derivatives of states that the prior knows where they were first estimated");
  }
};

struct VisionConfig {
  double pixel_sigma = 1.0;
  double huber_px = 1.5;
  double max_reprojection_px = 3.0;
  int min_sightings = 3;
  double min_parallax_deg = 0.3;
  double information_short = 0.25;
  double information_long = 1.0;
  int track_short = 4;
  int track_long = 10;
  bool estimate_extrinsics = false;
  bool estimate_time_offset = false;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("pixel_sigma", pixel_sigma, Range{0.01, 100.0},
      "of a residual on a long track: the noise of two corners, where it is anchored and where it "
      "is "
      "seen [px]");
    v("huber_px", huber_px, Range{0.01, 1000.0}, "larger residuals count linearly [px]");
    v("max_reprojection_px", max_reprojection_px, Range{0.1, 1000.0},
      "a landmark with a larger mean error is given up [px]");
    v("min_sightings", min_sightings, Range{2, 50}, "of a landmark that enters the graph");
    v("min_parallax_deg", min_parallax_deg, Range{0.0, 90.0},
      "angle between rays before a landmark is triangulated [deg]");
    v("information_short", information_short, Range{0.0, 1.0},
      "weight of a sighting on a track of `track_short` frames: the paper's beta");
    v("information_long", information_long, Range{0.0, 10.0},
      "and of `track_long` frames: the paper's alpha + beta");
    v("track_short", track_short, Range{1, 1000}, "the paper's n_min [frames]");
    v("track_long", track_long, Range{2, 1000}, "the paper's n_max [frames]");
    v("estimate_extrinsics", estimate_extrinsics, "refine where the cameras sit on the body");
    v("estimate_time_offset", estimate_time_offset, "refine by how much image stamps are late");
  }
};

struct StartConfig {
  double yaw_position_sigma = 1e-3;
  double gyro_bias_sigma = 0.05;
  double accel_bias_sigma = 0.1;
  double max_wait_s = 3.0;
  double dvl_s = 3.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("yaw_position_sigma", yaw_position_sigma, Range{1e-6, 1.0},
      "of what a start defines: the first frame's heading [rad] and position [m]");
    v("gyro_bias_sigma", gyro_bias_sigma, Range{1e-6, 1.0},
      "of the gyro's turn-on bias without a DVL [rad/s]");
    v("accel_bias_sigma", accel_bias_sigma, Range{1e-6, 10.0},
      "of the accelerometer's turn-on bias without a DVL [m/s²]");
    v("max_wait_s", max_wait_s, Range{0.2, 60.0}, "span of frames a start looks back at [s]");
    v("dvl_s", dvl_s, Range{0.0, 60.0},
      "with a DVL: so long after a start or a freeze its velocities are in the graph, whatever "
      "`graph`; at constant speed nothing else tells the scale [s]");
  }
};

struct HealthConfig {
  double max_reprojection_px = 2.5;
  double max_gyro_bias = 0.5;
  double max_accel_bias = 2.0;
  double max_speed = 10.0;
  double max_gyro = 8.7;
  double max_accel = 80.0;
  int max_bad_frames = 10;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("max_reprojection_px", max_reprojection_px, Range{0.1, 1000.0},
      "a frame with a larger root mean square is bad [px]");
    v("max_gyro_bias", max_gyro_bias, Range{0.0, 10.0}, "larger means divergence [rad/s]");
    v("max_accel_bias", max_accel_bias, Range{0.0, 100.0}, "larger means divergence [m/s²]");
    v("max_speed", max_speed, Range{0.0, 1000.0}, "larger means divergence [m/s]");
    v("max_gyro", max_gyro, Range{0.1, 100.0},
      "a sample that turns faster is a shock or a saturated sensor, and is left out [rad/s]");
    v("max_accel", max_accel, Range{10.0, 1000.0}, "the same for the specific force [m/s²]");
    v("max_bad_frames", max_bad_frames, Range{1, 1000}, "so many in a row mean divergence");
  }
};

struct TightConfig {
  bool velocity = true;
  bool depth = true;
  double huber_sigmas = 3.0;
  int believed_tracks = 100;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("believed_tracks", believed_tracks, Range{0, 100000},
      "while vision has failed a frame counts only if it follows at least so many corners");
    v("velocity", velocity, "a factor per DVL ping");
    v("depth", depth, "a factor per frame from the pressure or depth sensor");
    v("huber_sigmas", huber_sigmas, Range{0.1, 1000.0},
      "larger residuals of theirs count linearly");
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
  StartConfig start;
  InitConfig initializer;
  HealthConfig health;
  double gyro_noise_factor = 1.0;
  double accel_noise_factor = 1.0;
  double gravity = 9.80665;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("graph", graph,
      config::Choices<GraphKind>{{"paper", GraphKind::paper}, {"tight", GraphKind::tight}},
      "camera and IMU alone; or DVL and pressure in the same graph");
    v("stereo", stereo, "use a second camera where the rig has one");
    v("tracker", tracker, "the front end");
    v("window", window, "the sliding window");
    v("vision", vision, "landmarks");
    v("tight", tight, "what `graph: tight` adds");
    v("start", start, "how the window starts");
    v("initializer", initializer, "the start without a DVL");
    v("health", health, "when the window gives up");
    v("gyro_noise_factor", gyro_noise_factor, Range{0.1, 1000.0},
      "inflates the rig's gyro noise density");
    v("accel_noise_factor", accel_noise_factor, Range{0.1, 1000.0},
      "inflates the rig's accelerometer noise density");
    v("gravity", gravity, Range{9.0, 10.5}, "local gravity [m/s²]");
  }
};

}  // namespace apvi::vio
