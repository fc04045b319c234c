// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "apvi/geometry/trajectory.hpp"

namespace apvi::eval {

/// How poses of an estimate are associated with a reference.
enum class Association {
  /// The denser trajectory (within the common time span) is interpolated at the stamps of the
  /// other:
  /// stamps of a 1 Hz reference and of DVL pings hardly ever coincide.
  interpolate,
  /// Each pose of the trajectory with fewer poses is matched with the nearest in time of the other,
  /// as evo does by default. A pose may be matched twice.
  nearest,
};

struct AssociationOptions {
  Association mode = Association::interpolate;
  double max_difference_s = 0.01;  ///< `nearest`: maximum time difference [s]
  double max_gap_s = 2.0;          ///< `interpolate`: maximum gap to interpolate over [s]
};

/// Reference and estimated pose at the same time.
struct PosePair {
  Stamp stamp;
  SE3 reference;
  SE3 estimate;
};

/// The pairs in order of time; empty without overlap. Both trajectories must be sorted by time.
std::vector<PosePair> associate(const Trajectory& reference, const Trajectory& estimate,
                                const AssociationOptions& options);

/// Fraction of the reference's time span covered by the estimate, excluding gaps longer than
/// `max_gap_s`. In [0, 1].
double coverage(const Trajectory& reference, const Trajectory& estimate, double max_gap_s);

}  // namespace apvi::eval
