// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/config/fields.hpp"

namespace apvi::fusion {

/// Step 1 of the paper's Algorithm 1. "Stable" is vio::TrackerConfig::stable_frames.
struct CoarseConfig {
  int min_features = 50;
  double min_stable_ratio = 0.2;
  double min_spread = 0.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("min_features", min_features, Range{0, 100000}, "more corners than that (the paper: 50)");
    v("min_stable_ratio", min_stable_ratio, Range{0.0, 1.0},
      "a larger share of them than that is stable (the paper: 0.2)");
    v("min_spread", min_spread, Range{0.0, 1.0},
      "share of the image's cells that hold a corner at least (the paper: not asked, 0)");
  }
};

/// Step 2: VIO against DIPO.
struct MediumConfig {
  double max_position_m = 0.3;
  double max_height_m = 0.3;
  double max_rotation_deg = 10.0;
  double window_s = 10.0;
  bool needs_stable_dipo = true;
  double dipo_sigmas = 3.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("max_position_m", max_position_m, Range{0.0, 1e6}, "distance of the positions [m]");
    v("max_height_m", max_height_m, Range{0.0, 1e6}, "difference of the heights [m]");
    v("max_rotation_deg", max_rotation_deg, Range{0.0, 180.0}, "angle between the attitudes [deg]");
    v("window_s", window_s, Range{0.0, 3600.0},
      "compare how both moved over so long, since both drift; 0: where they are, and a frozen "
      "window leans on DIPO's position as it is (the paper) [s]");
    v("needs_stable_dipo", needs_stable_dipo,
      "do not blame VIO for disagreeing with a DIPO that is unstable itself (the paper: false)");
    v("dipo_sigmas", dipo_sigmas, Range{0.0, 100.0},
      "a difference that DIPO's own uncertainty over window_s explains does not count: so many "
      "sigmas of it; 0: every difference counts (the paper)");
  }
};

enum class Normalisation { none, per_inlier };
enum class DegeneracyAction { reject, remap, ignore };

/// Step 3: eigenvalues of VIO's information; 0: not tested. The thresholds are those of
/// `apvi calibrate` on the easy benchmark scenes with camera and IMU in the graph
/// (docs/calibration.md); DVL and pressure in the graph only add information.
struct FineConfig {
  double min_rotation = 2.89e6;
  double min_position = 332.0;
  double focal_px = 420.0;
  Normalisation normalisation = Normalisation::none;
  DegeneracyAction action = DegeneracyAction::reject;
  int min_directions = 3;

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    v("min_rotation", min_rotation, Range{0.0, 1e15},
      "smallest eigenvalue of the rotation block at least [1/rad²]; 0: not tested");
    v("min_position", min_position, Range{0.0, 1e15},
      "smallest eigenvalue of the position block at least [1/m²]; 0: not tested");
    v("focal_px", focal_px, Range{0.0, 1e5},
      "focal length of the camera that both thresholds were found with; another camera's count "
      "times the square of its own over this; 0: whatever the camera [px]");
    v("normalisation", normalisation,
      Choices<Normalisation>{{"none", Normalisation::none},
                             {"per_inlier", Normalisation::per_inlier}},
      "eigenvalues as they are (the paper), or divided by the number of inliers; the defaults "
      "above are for the former");
    v("action", action,
      Choices<DegeneracyAction>{{"reject", DegeneracyAction::reject},
                                {"remap", DegeneracyAction::remap},
                                {"ignore", DegeneracyAction::ignore}},
      "what a small eigenvalue does: VIO has failed (the paper); only the other directions are "
      "used (Zhang 2016); nothing");
    v("min_directions", min_directions, Range{1, 6},
      "remap: with fewer directions left VIO has failed");
  }
};

struct DiscriminatorConfig {
  CoarseConfig coarse;
  MediumConfig medium;
  FineConfig fine;

  template <typename V>
  void visit(V& v) {
    v("coarse", coarse, "step 1: corners");
    v("medium", medium, "step 2: agreement with DIPO");
    v("fine", fine, "step 3: degeneracy");
  }
};

/// When DIPO can carry the vehicle alone.
struct StabilityConfig {
  int nis_pings = 10;
  double max_nis = 5.0;
  double max_dvl_age_s = 2.0;
  double max_rotation_sigma_deg = 10.0;
  double max_position_sigma_m = 0.0;
  double growth_window_s = 2.0;
  double max_position_growth = 0.15;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("nis_pings", nis_pings, Range{1, 1000}, "pings that the median NIS is taken of");
    v("max_nis", max_nis, Range{0.0, 1e9}, "their median NIS per degree of freedom at most");
    v("max_dvl_age_s", max_dvl_age_s, Range{0.0, 3600.0}, "age of the last ping used [s]");
    v("max_rotation_sigma_deg", max_rotation_sigma_deg, Range{0.0, 180.0},
      "sigma of the tilt's worst axis [deg]; heading has no bound in dead reckoning");
    v("max_position_sigma_m", max_position_sigma_m, Range{0.0, 1e6},
      "sigma of the worst direction [m]; 0: not tested, since dead reckoning has no bound");
    v("growth_window_s", growth_window_s, Range{0.1, 3600.0},
      "span over which that sigma's growth is measured [s]");
    v("max_position_growth", max_position_growth, Range{0.0, 1e6}, "growth at most [m/s]");
  }
};

/// What a change of mind takes: how many frames (0 is the paper: one), and how much better than the
/// thresholds.
struct HysteresisConfig {
  int good_frames = 3;
  int bad_frames = 2;
  double return_factor = 1.5;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("good_frames", good_frames, Range{0, 10000},
      "good frames in a row before VIO is used again (the paper: 0)");
    v("bad_frames", bad_frames, Range{0, 10000},
      "bad frames in a row before VIO has failed (the paper: 0); no bad frame is ever fused");
    v("return_factor", return_factor, Range{1.0, 100.0},
      "after a failure the share of stable corners that step 1 asks for is so many times larger: "
      "in silt it comes and goes about the threshold, and what moves is the silt (the paper: 1)");
  }
};

/// The filter behind `consistent: relative`.
struct RelativeConfig {
  double shared_noise = 1.0;
  double min_rotation_walk_deg = 0.01;
  double min_position_walk = 0.001;
  double tie_rotation_deg = 0.02;
  double tie_position_m = 0.002;
  double gate = 22.5;
  double growth_s = 5.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("shared_noise", shared_noise, Range{0.0, 1.0},
      "how much of the smaller noise both subsystems have in common, since both read one IMU");
    v("min_rotation_walk_deg", min_rotation_walk_deg, Range{1e-6, 100.0},
      "neither drifts less than that [deg/sqrt(s)]");
    v("min_position_walk", min_position_walk, Range{1e-6, 100.0}, "the same [m/sqrt(s)]");
    v("tie_rotation_deg", tie_rotation_deg, Range{1e-6, 100.0},
      "error of a single VIO pose that is gone in the next one [deg]");
    v("tie_position_m", tie_position_m, Range{1e-6, 100.0}, "the same [m]");
    v("gate", gate, Range{1.0, 1e9},
      "NIS above which a motion seen by VIO is not used (chi square of six, 0.1 %)");
    v("growth_s", growth_s, Range{0.01, 1000.0},
      "how fast the subsystems drift is told from the growth of their covariances, smoothed over "
      "so long [s]");
  }
};

/// How the output passes over a switch.
struct SlewConfig {
  double time_constant_s = 1.0;
  double min_speed_m_s = 0.1;
  double min_rate_deg_s = 2.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("time_constant_s", time_constant_s, Range{0.0, 3600.0},
      "what DIPO's motion does not explain enters the output with this time constant; 0: at once "
      "(the paper) [s]");
    v("min_speed_m_s", min_speed_m_s, Range{0.0, 1e6}, "but at least at this speed [m/s]");
    v("min_rate_deg_s", min_rate_deg_s, Range{0.0, 1e6}, "and at this rate [deg/s]");
  }
};

enum class Mode { paper, consistent };
enum class Consistent { relative, intersection };

/// The `fusion` section.
struct Config {
  Mode mode = Mode::consistent;
  Consistent consistent = Consistent::relative;
  DiscriminatorConfig discriminator;
  StabilityConfig dipo_stability;
  HysteresisConfig hysteresis;
  RelativeConfig relative;
  SlewConfig slew;

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    v("mode", mode, Choices<Mode>{{"paper", Mode::paper}, {"consistent", Mode::consistent}},
      "Eq. 7 as printed, or without counting what both subsystems share twice");
    v("consistent", consistent,
      Choices<Consistent>{{"relative", Consistent::relative},
                          {"intersection", Consistent::intersection}},
      "how: only the motion that VIO sees; covariance intersection of the poses");
    v("discriminator", discriminator, "Algorithm 1: whether VIO can be used");
    v("dipo_stability", dipo_stability, "whether DIPO can: freeze or drop");
    v("hysteresis", hysteresis, "how many frames a change of mind takes");
    v("relative", relative, "filter of the relative mode");
    v("slew", slew, "the output over a switch");
  }
};

/// The `freeze` section: what happens to VIO's window while vision is gone.
struct FreezeConfig {
  bool enabled = true;
  int release_frames = 3;
  double max_frozen_s = 0.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled,
      "hold VIO's window while DIPO carries on; false: VIO starts anew after every failure");
    v("release_frames", release_frames, Range{1, 10000},
      "good frames in a row that release a frozen window, or end a new start");
    v("max_frozen_s", max_frozen_s, Range{0.0, 1e9},
      "after so long VIO starts anew all the same; 0: never [s]");
  }
};

}  // namespace apvi::fusion
