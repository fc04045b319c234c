// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "apvi/config/fields.hpp"
#include "apvi/eval/association.hpp"
#include "apvi/eval/statistics.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/rig.hpp"

namespace apvi::eval {

/// The motion that is taken out of the estimate before positions are compared.
enum class Alignment {
  se3,    ///< best rigid motion (Umeyama 1991, no scale)
  yaw,    ///< best translation and rotation about the vertical: gravity has fixed the rest
  first,  ///< makes the first matched poses equal (evo: `--align_origin`)
  none,   ///< nothing: both are in one world already
};

/// What is compared and how. In a configuration file: align, associate, max_difference_s,
/// max_gap_s, heldout_every.
struct EvalOptions {
  Alignment alignment = Alignment::se3;
  AssociationOptions association;
  /// World of each trajectory. A vehicle's estimate may be north-east-down while GNSS is east,
  /// north, up; both are turned to z up before anything is compared. In three dimensions that is a
  /// rotation, but seen from above x and y change places, which no alignment in the plane could
  /// make good.
  WorldFrame reference_world = WorldFrame::up;
  WorldFrame estimate_world = WorldFrame::up;
  int heldout_every = 8;  ///< of the images: kept from mapping, which is measured on them

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    v("align", alignment,
      Choices<Alignment>{{"se3", Alignment::se3},
                         {"yaw", Alignment::yaw},
                         {"first", Alignment::first},
                         {"none", Alignment::none}},
      "motion taken out of the estimate before the absolute error is measured");
    v("associate", association.mode,
      Choices<Association>{{"auto", Association::interpolate}, {"nearest", Association::nearest}},
      "auto interpolates the denser trajectory, nearest pairs what is close in time");
    v("max_difference_s", association.max_difference_s, Range{0.0, 1e6},
      "nearest: largest distance of a pair in time [s]");
    v("max_gap_s", association.max_gap_s, Range{0.0, 1e6},
      "gaps longer than this are neither interpolated nor covered [s]");
    v("heldout_every", heldout_every, Range{0, 1000000},
      "the first image and every so manieth after it is kept from mapping, which is measured on "
      "them; 0: none");
  }
};

/// Why a figure is not there.
enum class Reason {
  computed,
  no_overlap,       ///< the spans in time have nothing in common
  too_few_matches,  ///< fewer pairs than `needed_matches`
  no_orientation,   ///< one of the two has positions only
  no_height,        ///< the reference is planar
  undetermined,  ///< all positions lie on one point or line: the alignment's rotation is arbitrary
  too_short,     ///< no pair of poses is that far apart
};
/// The reason in words, for a table or a log.
std::string_view to_string(Reason reason);

/// Statistics of an error, or why there are none.
struct Figure {
  std::optional<Statistics> value;
  Reason reason = Reason::computed;
};

/// Spans that relative errors are measured over.
inline constexpr double kRelativeTime = 1.0;       ///< [s]
inline constexpr double kRelativeDistance = 10.0;  ///< [m]

/// How far an estimate is from a reference. Definitions are those of evo, "Python package for the
/// evaluation of odometry and SLAM" (`evo_ape -a`, `evo_rpe`).
struct TrajectoryMetrics {
  Figure ate;  ///< position error after the alignment [m]; horizontal for a planar reference
  Figure ate_first_pose;  ///< the same, with the first poses made equal [m]
  Figure rotation_deg;    ///< angle between the orientations after the alignment [deg]
  Figure rpe_time;        ///< error of relative positions over 1 s, every pair of poses [m]
  /// The same over 10 m of the estimate's path, pair after pair; as evo up to 1.37, where the first
  /// pair starts 10 m into the path.
  Figure rpe_distance;
  Figure rpe_distance_all_pairs;  ///< over 10 m, a pair from every pose (tolerance 1 m) [m]

  std::optional<double> ate_percent_of_path;  ///< ATE RMSE in percent of `path_length_m`
  std::optional<double> path_length_m;        ///< of the reference at the matched stamps
  std::optional<double> coverage;             ///< see eval::coverage
  std::optional<std::size_t> matched;         ///< number of pairs
  std::optional<double> end_to_start_m;       ///< from the first to the last estimated position
  std::optional<double> estimate_length_m;    ///< of the estimated path
};

/// Compares an estimate with a reference; both sorted by time. Estimated poses with a number that
/// is not finite count as missing. Throws nothing: what cannot be computed says why.
TrajectoryMetrics evaluate(const Trajectory& reference, const Trajectory& estimate,
                           const EvalOptions& options = {});

/// Pairs without which nothing is computed: three for se3, two for anything else.
std::size_t needed_matches(Alignment alignment);

/// What can be said without a reference: how far a run that closes its loop ends from its start.
TrajectoryMetrics evaluate_alone(const Trajectory& estimate);

/// The world of a reference that belongs to a vehicle: GNSS, known by having positions only, is
/// east, north, up; a pose shares the vehicle's world.
WorldFrame reference_world(const Trajectory& reference, WorldFrame vehicle_world);

/// The poses from `from` to `to`, both included.
Trajectory within(const Trajectory& trajectory, Stamp from, Stamp to);
/// The part of a reference that a run over a part of a recording answers for: from its first sample
/// on, for `duration_s` seconds; 0 for all the rest.
Trajectory seen_part(const Trajectory& reference, Stamp first_sample, double duration_s);

/// The trajectory in a world with z up: north-east-down becomes east, north, up.
Trajectory to_z_up(const Trajectory& trajectory, WorldFrame world);

/// How the two lie in time, for a message: "the estimate spans 0.000 to 9.000 s, ...".
std::string describe_spans(const Trajectory& reference, const Trajectory& estimate);

}  // namespace apvi::eval
