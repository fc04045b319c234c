// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string_view>

#include "apvi/fusion/config.hpp"
#include "apvi/fusion/degeneracy.hpp"
#include "apvi/vio/observation.hpp"

namespace apvi::fusion {

/// Which step of Algorithm 1 turned VIO down.
enum class Level { accepted, input, coarse, medium, fine };

enum class Reason {
  none,
  no_image,             ///< the frame is not good; measured: the vio::FrameQuality
  no_estimate,          ///< VIO has not started
  diverged,             ///< VIO says so, or a number is not finite
  too_few_features,     ///< measured: corners
  too_few_stable,       ///< measured: share of stable ones
  too_little_spread,    ///< measured: share of cells
  position_differs,     ///< measured [m]
  height_differs,       ///< measured [m]
  rotation_differs,     ///< measured [deg]
  no_landmarks,         ///< none in the solution, whatever other sensors know
  rotation_degenerate,  ///< measured: smallest eigenvalue [1/rad²], per inlier if so configured
  position_degenerate,  ///< the same [1/m²]
};
std::string_view to_string(Level level);
std::string_view to_string(Reason reason);

/// What was decided, and the number that decided. Of an accepted frame both numbers are zero.
struct Verdict {
  Level level = Level::accepted;
  Reason reason = Reason::none;
  double measured = 0.0;
  double threshold = 0.0;

  bool accepted() const { return level == Level::accepted; }
};

/// VIO's newest pose.
struct VioEstimate {
  SE3 T_world_body;
  Matrix6 information = Matrix6::Zero();  ///< marginal, of T_world_body ⊞ error
  /// The same with the oldest pose of the window held: of the motion over the window, which does
  /// not decay as VIO drifts. Where it is given step 3 tests it, and `consistent: relative` takes
  /// VIO's noise from it.
  std::optional<Matrix6> window_information;
  double window_s = 0.0;  ///< from that oldest pose to this one [s]
  int inliers = 0;        ///< corners in the solution
  bool healthy = true;    ///< false: the solver failed or the state left its bounds
};

/// Step 1, Coarse: `n_fp > 50 and n_sfp > 0.2 n_fp`. n_fp are all corners of the front end, new
/// ones included; they count for the share of stable ones.
Verdict coarse(const vio::FrameStatistics& statistics, const CoarseConfig& config);

/// Step 2, Medium: `‖x_DIPO - x_VIO‖ < 30 cm and |z_DIPO - z_VIO| < 30 cm and Δθ < 10°`. The norm
/// is the position's; Δθ is the angle of the rotation between the two, which no Euler angle of it
/// exceeds.
Verdict medium(const SE3& dipo, const SE3& vio, const MediumConfig& config);

/// Variance by which DIPO's pose may have wandered: what it lost by dead reckoning and what
/// measurements took back moved it alike, so both add up. Over a span: the difference of two sums.
struct Wander {
  double rotation = 0.0;  ///< [rad²]
  double position = 0.0;  ///< [m²]
  double height = 0.0;    ///< [m²]

  void add(const PoseEstimate& before, const PoseEstimate& after);
  Wander since(const Wander& then) const;
};

/// The limits of step 2 where DIPO is less sure of its own motion than they are tight.
MediumConfig widened(const MediumConfig& config, const Wander& dipo);

/// Step 3, Fine: no eigenvalue of either block below its threshold (Eq. 6).
Verdict fine(const Eigenvalues& eigenvalues, const EigenThresholds& thresholds);

/// The configuration with its thresholds for a camera of that focal length: a pixel's error is an
/// angle, so the information of a scene goes with the square of the focal length.
FineConfig for_camera(const FineConfig& config, double focal_px);

/// What step 3 tests, normalised as configured.
Eigenvalues tested_eigenvalues(const VioEstimate& vio, const FineConfig& config);

}  // namespace apvi::fusion
