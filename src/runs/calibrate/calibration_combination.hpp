// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

/// One calibration from those of several dives. Vectors have an element per component of the
/// calibration; changes are differences from the rig's values.
namespace apvi::runs {

/// What one dive knows, with the prior in it.
struct DiveKnowledge {
  Eigen::VectorXd change;
  Eigen::MatrixXd covariance;
};

struct CombinationInput {
  /// The uncertainty of the rig's values.
  Eigen::VectorXd prior_sigma;
  /// The calibration with which the dives were run, on which their priors were centered.
  Eigen::VectorXd start;
  /// The parameter to which a component belongs, counted from 0.
  std::vector<int> parameter;
  std::vector<DiveKnowledge> dives;
};

struct Combination {
  /// Zero where not observable: the rig's value is kept.
  Eigen::VectorXd change;
  Eigen::VectorXd sigma;
  std::vector<bool> observable;  ///< sigma is below half of the prior's
  /// By parameter: mean square of the dives' differences from `change` in their standard
  /// deviations, about 1 for sound ones; NaN with less than two dives that observe it.
  std::vector<double> consistency;
};

/// Information of a dive is the inverse of its covariance less that of the prior, and is added to
/// the prior once. Components that nothing told are held at the rig's values, and the others
/// estimated under this condition. Where the dives disagree by more than their standard deviations,
/// these are too small by the square root of `consistency` (R. T. Birge, "The calculation of errors
/// by the method of least squares", 1932): all information of the dives is divided by its mean over
/// the parameters if that is above 1, and the sigma of a parameter has at least its own factor.
/// Common errors of all dives do not show.
Combination combine(const CombinationInput& input);

}  // namespace apvi::runs
