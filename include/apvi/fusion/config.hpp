// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/config/fields.hpp"

namespace apvi::fusion {

/// Step 1 of the paper's Algorithm 1. "Stable" is vio::TrackerConfig::stable_s.
struct TrackingCheckConfig {
  int min_features = 50;
  double min_stable_ratio = 0.2;
  double min_grid_coverage = 0.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("min_features", min_features, Range{0, 100000},
      "VIO has failed at this many corners or fewer (the paper: 50)");
    v("min_stable_ratio", min_stable_ratio, Range{0.0, 1.0},
      "VIO has failed at this fraction of stable corners or less (the paper: 0.2)");
    v("min_grid_coverage", min_grid_coverage, Range{0.0, 1.0},
      "minimum fraction of image grid cells with a corner (the paper: 0)");
  }
};

/// Step 2: VIO against DIPO.
struct AgreementCheckConfig {
  double max_position_m = 0.3;
  double max_height_m = 0.3;
  double max_rotation_deg = 10.0;
  double window_s = 10.0;
  bool require_stable_dipo = true;
  double dipo_sigmas = 3.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("max_position_m", max_position_m, Range{0.0, 1e6}, "maximum position difference [m]");
    v("max_height_m", max_height_m, Range{0.0, 1e6}, "maximum height difference [m]");
    v("max_rotation_deg", max_rotation_deg, Range{0.0, 180.0}, "maximum attitude difference [deg]");
    v("window_s", window_s, Range{0.0, 3600.0},
      "compare the motion over this window, as both drift; 0: compare absolute poses and hold a "
      "frozen window at DIPO's position (the paper) [s]");
    v("require_stable_dipo", require_stable_dipo,
      "skip the comparison while DIPO is unstable (the paper: false)");
    v("dipo_sigmas", dipo_sigmas, Range{0.0, 100.0},
      "differences within this many sigmas of DIPO's own uncertainty over window_s are ignored; 0: "
      "none (the paper)");
  }
};

enum class Normalization { none, per_inlier };
enum class DegeneracyAction { reject, remap, ignore };

/// Step 3: eigenvalues of VIO's information; 0: not tested. The threshold of position is that of
/// `apvi calibrate` on the easy benchmark scenes with camera and IMU in the graph
/// (docs/calibration.md); DVL and pressure in the graph only add information. Rotation is not
/// tested: its information is the gyro's, so a threshold rejects sound windows of another IMU.
struct DegeneracyCheckConfig {
  double min_rotation_eigenvalue = 0.0;
  double min_position_eigenvalue = 332.0;
  double reference_focal_px = 420.0;
  Normalization normalization = Normalization::none;
  DegeneracyAction action = DegeneracyAction::reject;
  int min_directions = 3;

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    v("min_rotation_eigenvalue", min_rotation_eigenvalue, Range{0.0, 1e15},
      "minimum eigenvalue of the rotation block [1/rad²]; 0: not tested");
    v("min_position_eigenvalue", min_position_eigenvalue, Range{0.0, 1e15},
      "minimum eigenvalue of the position block [1/m²]; 0: not tested");
    v("reference_focal_px", reference_focal_px, Range{0.0, 1e5},
      "focal length at which both thresholds were calibrated; they scale with the square of the "
      "focal length; 0: no scaling [px]");
    v("normalization", normalization,
      Choices<Normalization>{{"none", Normalization::none},
                             {"per_inlier", Normalization::per_inlier}},
      "none: eigenvalues as they are (the paper; the default thresholds are for these); "
      "per_inlier: divided by the number of inliers");
    v("action", action,
      Choices<DegeneracyAction>{{"reject", DegeneracyAction::reject},
                                {"remap", DegeneracyAction::remap},
                                {"ignore", DegeneracyAction::ignore}},
      "below a threshold: reject: VIO has failed (the paper); remap: fuse the well-conditioned "
      "directions only (Zhang 2016); ignore: nothing");
    v("min_directions", min_directions, Range{1, 6},
      "remap: VIO has failed with fewer well-conditioned directions");
  }
};

struct DiscriminatorConfig {
  TrackingCheckConfig tracking;
  AgreementCheckConfig agreement;
  DegeneracyCheckConfig degeneracy;

  template <typename V>
  void visit(V& v) {
    v("tracking", tracking, "step 1 (the paper: coarse): feature tracking");
    v("agreement", agreement, "step 2 (the paper: medium): agreement with DIPO");
    v("degeneracy", degeneracy, "step 3 (the paper: fine): degeneracy of VIO's information matrix");
  }
};

/// When DIPO is stable enough to navigate without VIO.
struct StabilityConfig {
  int nis_window_pings = 10;
  double max_median_nis = 5.0;
  double max_dvl_age_s = 2.0;
  double max_tilt_sigma_deg = 10.0;
  double max_position_sigma_m = 0.0;
  double growth_window_s = 2.0;
  double max_position_sigma_growth_m_s = 0.15;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("nis_window_pings", nis_window_pings, Range{1, 1000}, "number of pings in the median NIS");
    v("max_median_nis", max_median_nis, Range{0.0, 1e9},
      "maximum median NIS per degree of freedom");
    v("max_dvl_age_s", max_dvl_age_s, Range{0.0, 3600.0}, "maximum age of the last ping used [s]");
    v("max_tilt_sigma_deg", max_tilt_sigma_deg, Range{0.0, 180.0},
      "maximum roll and pitch uncertainty, one sigma [deg]; heading is unbounded in dead "
      "reckoning");
    v("max_position_sigma_m", max_position_sigma_m, Range{0.0, 1e6},
      "maximum position uncertainty, one sigma [m]; 0: not tested, as it is unbounded in dead "
      "reckoning");
    v("growth_window_s", growth_window_s, Range{0.1, 3600.0},
      "window over which the growth of the position uncertainty is measured [s]");
    v("max_position_sigma_growth_m_s", max_position_sigma_growth_m_s, Range{0.0, 1e6},
      "maximum growth of the position uncertainty [m/s]");
  }
};

/// Hysteresis of the VIO state: for how long consecutive frames must say the same (0, as in the
/// paper: one frame is enough), and a stricter threshold after a failure.
struct HysteresisConfig {
  double good_s = 0.09;
  double bad_s = 0.04;
  double recovery_stable_ratio_factor = 1.5;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("good_s", good_s, Range{0.0, 60.0},
      "time from the first to the last of consecutive good frames before VIO is used again (the "
      "paper: 0) [s]");
    v("bad_s", bad_s, Range{0.0, 60.0},
      "time from the first to the last of consecutive bad frames before VIO has failed (the paper: "
      "0); a bad frame is never fused [s]");
    v("recovery_stable_ratio_factor", recovery_stable_ratio_factor, Range{1.0, 100.0},
      "factor on min_stable_ratio after a failure, as drifting silt keeps the ratio near the "
      "threshold (the paper: 1)");
  }
};

/// The filter of `consistent_method: relative`.
struct RelativeConfig {
  double shared_noise_fraction = 1.0;
  double min_rotation_walk_deg_sqrt_s = 0.01;
  double min_position_walk_m_sqrt_s = 0.001;
  double pose_noise_deg = 0.02;
  double pose_noise_m = 0.002;
  double nis_gate = 22.5;
  double drift_smoothing_s = 5.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("shared_noise_fraction", shared_noise_fraction, Range{0.0, 1.0},
      "fraction of the smaller process noise that is common to both estimators, as they share the "
      "IMU");
    v("min_rotation_walk_deg_sqrt_s", min_rotation_walk_deg_sqrt_s, Range{1e-6, 100.0},
      "lower bound on the rotation drift of either estimator [deg/sqrt(s)]");
    v("min_position_walk_m_sqrt_s", min_position_walk_m_sqrt_s, Range{1e-6, 100.0},
      "lower bound on the position drift of either estimator [m/sqrt(s)]");
    v("pose_noise_deg", pose_noise_deg, Range{1e-6, 100.0},
      "white rotation noise of a VIO pose, one sigma [deg]");
    v("pose_noise_m", pose_noise_m, Range{1e-6, 100.0},
      "white position noise of a VIO pose, one sigma [m]");
    v("nis_gate", nis_gate, Range{1.0, 1e9},
      "NIS above which a relative motion of VIO is rejected (chi-square, 6 degrees of freedom, 0.1 "
      "%)");
    v("drift_smoothing_s", drift_smoothing_s, Range{0.01, 1000.0},
      "smoothing window of the drift rates, which come from the growth of the covariances [s]");
  }
};

/// Transition of the output at a switch between sources.
struct SlewConfig {
  double time_constant_s = 1.0;
  double min_speed_m_s = 0.1;
  double min_rate_deg_s = 2.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("time_constant_s", time_constant_s, Range{0.0, 3600.0},
      "time constant at which a jump enters the output; 0: at once (the paper) [s]");
    v("min_speed_m_s", min_speed_m_s, Range{0.0, 1e6},
      "minimum speed of the position correction [m/s]");
    v("min_rate_deg_s", min_rate_deg_s, Range{0.0, 1e6},
      "minimum rate of the rotation correction [deg/s]");
  }
};

enum class Mode { paper, consistent };
enum class Consistent { relative, intersection };

/// The `fusion` section.
struct Config {
  Mode mode = Mode::consistent;
  Consistent consistent_method = Consistent::relative;
  bool bypass_for_tight_graph = true;
  DiscriminatorConfig discriminator;
  StabilityConfig dipo_stability;
  HysteresisConfig hysteresis;
  RelativeConfig relative;
  SlewConfig slew;

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    v("mode", mode, Choices<Mode>{{"paper", Mode::paper}, {"consistent", Mode::consistent}},
      "paper: Eq. 7 as printed; consistent: information shared by both estimators is counted once");
    v("consistent_method", consistent_method,
      Choices<Consistent>{{"relative", Consistent::relative},
                          {"intersection", Consistent::intersection}},
      "mode consistent: relative: fuse the relative motion seen by VIO; intersection: covariance "
      "intersection of the poses");
    v("bypass_for_tight_graph", bypass_for_tight_graph,
      "with vio.graph: tight, whose window includes DIPO's sensors: mode consistent outputs VIO's "
      "pose unless step 2 rejects it, and an unstable DIPO does not reset the window; false: "
      "Algorithm 1 and Eq. 7 as with graph: paper");
    v("discriminator", discriminator, "Algorithm 1: detection of VIO failures");
    v("dipo_stability", dipo_stability,
      "stability check of DIPO: decides between freezing and dropping while VIO has failed");
    v("hysteresis", hysteresis, "hysteresis of the VIO state");
    v("relative", relative, "filter of consistent_method: relative");
    v("slew", slew, "smoothing of the output across a switch between VIO and DIPO");
  }
};

/// What becomes of the frozen frames when vision has recovered.
enum class FrozenFrames { remove, unfreeze };

/// The `freeze` section: handling of VIO's window during a vision failure.
struct FreezeConfig {
  bool enabled = true;
  FrozenFrames frozen_frames = FrozenFrames::remove;
  double release_s = 0.09;
  double max_frozen_s = 0.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled,
      "keep VIO's window frozen while DIPO continues; false: re-initialize VIO after every "
      "failure");
    v("frozen_frames", frozen_frames,
      config::Choices<FrozenFrames>{{"remove", FrozenFrames::remove},
                                    {"unfreeze", FrozenFrames::unfreeze}},
      "with vio.graph: paper: what becomes of the frozen frames after a failure: remove them, and "
      "continue from the pose of DIPO; unfreeze them with the prior they had (the paper)");
    v("release_s", release_s, Range{0.0, 60.0},
      "time from the first to the last of consecutive good frames that release a frozen window or "
      "complete a re-initialization; 0: one frame [s]");
    v("max_frozen_s", max_frozen_s, Range{0.0, 1e9},
      "re-initialize VIO after a longer freeze; 0: never [s]");
  }
};

}  // namespace apvi::fusion
