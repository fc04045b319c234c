// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string_view>

#include "apvi/fusion/config.hpp"
#include "fusion/degeneracy.hpp"
#include "vio/window/observation.hpp"

namespace apvi::fusion {

/// The step of Algorithm 1 that rejected VIO.
enum class Level { accepted, input, coarse, medium, fine };

enum class Reason {
  none,
  no_image,             ///< bad frame; measured: the vio::FrameQuality
  no_estimate,          ///< VIO not initialized
  diverged,             ///< reported by VIO, or a value is not finite
  too_few_features,     ///< measured: corners
  too_few_stable,       ///< measured: fraction of stable corners
  too_little_spread,    ///< measured: fraction of grid cells with a corner
  position_differs,     ///< measured [m]
  height_differs,       ///< measured [m]
  rotation_differs,     ///< measured [deg]
  no_landmarks,         ///< no landmark in the solution, whatever the other sensors contribute
  rotation_degenerate,  ///< measured: smallest eigenvalue [1/rad²], per inlier if so configured
  position_degenerate,  ///< the same [1/m²]
};
std::string_view to_string(Level level);
std::string_view to_string(Reason reason);

/// Result of Algorithm 1: the reason of a rejection with the measured value and its threshold. Both
/// values are zero for an accepted frame.
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
  /// The same with the oldest pose of the window held fixed: information about the motion over the
  /// window, which does not decay as VIO drifts. If given, step 3 tests it and `consistent:
  /// relative` derives the noise of VIO from it.
  std::optional<Matrix6> window_information;
  double window_s = 0.0;  ///< time from the oldest pose to this one [s]
  int inliers = 0;        ///< corners in the solution
  bool healthy = true;    ///< false: the solver failed or a state exceeded its limits
};

/// Step 1 (Coarse): `n_fp > 50 and n_sfp > 0.2 n_fp`. n_fp counts all corners of the front end,
/// including new ones; n_sfp the stable ones.
Verdict check_tracking(const vio::FrameStatistics& statistics, const TrackingCheckConfig& config);

/// Step 2 (Medium): `‖x_DIPO - x_VIO‖ < 30 cm and |z_DIPO - z_VIO| < 30 cm and Δθ < 10°`. The norm
/// is that of the position; Δθ is the angle of the relative rotation, an upper bound for each of
/// its Euler angles.
Verdict check_agreement(const SE3& dipo, const SE3& vio, const AgreementCheckConfig& config);

/// Accumulated drift variance of the DIPO pose. Dead reckoning and measurement updates both move
/// the pose, so the absolute changes of variance are summed. The drift over a span is the
/// difference of two sums.
struct DriftVariance {
  double rotation = 0.0;  ///< [rad²]
  double position = 0.0;  ///< [m²]
  double height = 0.0;    ///< [m²]

  void add(const PoseEstimate& before, const PoseEstimate& after);
  DriftVariance since(const DriftVariance& earlier) const;
};

/// The limits of step 2, widened where the uncertainty of DIPO exceeds them.
AgreementCheckConfig widen_limits(const AgreementCheckConfig& config, const DriftVariance& dipo);

/// Step 3 (Fine): no eigenvalue of either block below its threshold (Eq. 6).
Verdict check_degeneracy(const Eigenvalues& eigenvalues, const EigenThresholds& thresholds);

/// The configuration with its thresholds scaled to a focal length: a pixel error is an angle, so
/// the information of a scene grows with the square of the focal length.
DegeneracyCheckConfig scale_to_camera(const DegeneracyCheckConfig& config, double focal_px);

/// Eigenvalues tested in step 3, normalized as configured.
Eigenvalues tested_eigenvalues(const VioEstimate& vio, const DegeneracyCheckConfig& config);

}  // namespace apvi::fusion
