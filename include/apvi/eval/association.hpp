// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "apvi/geometry/trajectory.hpp"

namespace apvi::eval {

/// How poses of an estimate find their counterparts in a reference.
enum class Association {
  /// The denser of the two, by what lies in the span that both have, is interpolated at the stamps
  /// of the other: a reference at 1 Hz and an estimate at the pings of a DVL never meet by chance.
  interpolate,
  /// Each pose of the trajectory that has fewer takes the nearest of the other, as evo does by
  /// default. A pose can be taken twice.
  nearest,
};

struct AssociationOptions {
  Association mode = Association::interpolate;
  double max_difference_s = 0.01;  ///< `nearest`: largest distance in time [s]
  double max_gap_s = 2.0;          ///< `interpolate`: no pose is made up in a longer gap [s]
};

/// Where the vehicle was and where it was thought to be, at one time.
struct PosePair {
  Stamp stamp;
  SE3 reference;
  SE3 estimate;
};

/// The pairs, in order of time; empty when the spans do not overlap. Both must be sorted by time.
std::vector<PosePair> associate(const Trajectory& reference, const Trajectory& estimate,
                                const AssociationOptions& options);

/// The fraction of the reference's span that the estimate covers, gaps longer than `max_gap_s` and
/// the time before its first and after its last pose not counted. In [0, 1].
double coverage(const Trajectory& reference, const Trajectory& estimate, double max_gap_s);

}  // namespace apvi::eval
