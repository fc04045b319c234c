// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "apvi/config/fields.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/rig.hpp"
#include "eval/association.hpp"
#include "eval/statistics.hpp"

namespace apvi::eval {

/// Alignment of the estimate to the reference before positions are compared.
enum class Alignment {
  se3,    ///< rigid, least squares (Umeyama 1991, without scale)
  sim3,   ///< the same with scale, for estimates up to scale
  yaw,    ///< translation and yaw; roll and pitch are observable from gravity
  first,  ///< aligns the first matched poses (evo: `--align_origin`)
  none,   ///< no alignment: both are in the same world frame
};

/// Evaluation options. In a configuration file: align, associate, max_difference_s, max_gap_s,
/// heldout_every.
struct EvalOptions {
  Alignment alignment = Alignment::se3;
  AssociationOptions association;
  /// World frame of each trajectory. An estimate may be north-east-down while GNSS is
  /// east-north-up; both are converted to z up first. For a planar reference this matters: NED to
  /// ENU swaps x and y, which no alignment in the plane can undo.
  WorldFrame reference_world = WorldFrame::up;
  WorldFrame estimate_world = WorldFrame::up;
  int heldout_every = 8;  ///< every N-th image is held out from mapping for evaluation

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    v("align", alignment,
      Choices<Alignment>{{"se3", Alignment::se3},
                         {"sim3", Alignment::sim3},
                         {"yaw", Alignment::yaw},
                         {"first", Alignment::first},
                         {"none", Alignment::none}},
      "alignment of the estimate to the reference before the ATE; se3 becomes sim3 when the scale "
      "is unknown");
    v("associate", association.mode,
      Choices<Association>{{"auto", Association::interpolate}, {"nearest", Association::nearest}},
      "auto: interpolate the denser trajectory; nearest: pair poses nearest in time");
    v("max_difference_s", association.max_difference_s, Range{0.0, 1e6},
      "nearest: maximum time difference of a pair [s]");
    v("max_gap_s", association.max_gap_s, Range{0.0, 1e6},
      "longer gaps are not interpolated and not counted as covered [s]");
    v("heldout_every", heldout_every, Range{0, 1000000},
      "the first and every N-th image after it are held out from mapping, for evaluation; 0: none");
  }
};

/// Why a metric is missing.
enum class Reason {
  computed,
  no_overlap,       ///< no common time span
  too_few_matches,  ///< fewer pairs than `min_matches`
  no_orientation,   ///< one of the two has positions only
  no_height,        ///< the reference is planar
  undetermined,     ///< collinear positions: the alignment's rotation is ambiguous
  too_short,        ///< no pair of poses is that far apart
};
/// The reason as text, for tables and logs.
std::string_view to_string(Reason reason);

/// Statistics of an error, or the reason why it is missing.
struct ErrorMetric {
  std::optional<Statistics> value;
  Reason reason = Reason::computed;
};

/// Spans of the relative pose errors.
inline constexpr double kRpeTime_s = 1.0;       ///< [s]
inline constexpr double kRpeDistance_m = 10.0;  ///< [m]

/// Error metrics of an estimate. Definitions follow evo, "Python package for the
/// evaluation of odometry and SLAM" (`evo_ape -a`, `evo_rpe`).
struct TrajectoryMetrics {
  ErrorMetric ate;  ///< position error after the alignment [m]; horizontal for a planar reference
  ErrorMetric ate_first_pose;  ///< position error with the first poses aligned [m]
  ErrorMetric rotation_deg;    ///< angle between the orientations after the alignment [deg]
  ErrorMetric rpe_time;        ///< relative position error over 1 s, all pairs [m]
  /// Relative position error over 10 m of the estimated path, consecutive pairs; as in evo up to
  /// 1.37, where the first pair starts 10 m into the path.
  ErrorMetric rpe_distance;
  ErrorMetric rpe_distance_all_pairs;  ///< over 10 m, all pairs (tolerance 1 m) [m]

  /// Lengths of the estimate were multiplied by this, sim3 only.
  std::optional<double> scale_to_reference;
  std::optional<double> ate_percent_of_path;  ///< ATE RMSE in percent of `path_length_m`
  std::optional<double> path_length_m;        ///< of the reference at the matched stamps
  std::optional<double> coverage;             ///< see eval::coverage
  std::optional<std::size_t> matched;         ///< number of pairs
  std::optional<double> end_to_start_m;       ///< from the first to the last estimated position
  std::optional<double> estimate_length_m;    ///< of the estimated path
};

/// Compares an estimate with a reference; both sorted by time. Non-finite poses count as missing.
/// Does not throw: metrics that cannot be computed have a reason.
TrajectoryMetrics evaluate(const Trajectory& reference, const Trajectory& estimate,
                           const EvalOptions& options = {});

/// Minimum number of pairs: three for se3 and sim3, otherwise two.
std::size_t min_matches(Alignment alignment);

/// Metrics without a reference: path length, and distance from end to start for closed loops.
TrajectoryMetrics evaluate_without_reference(const Trajectory& estimate);

/// World frame of a reference: GNSS (positions only) is east-north-up; a reference with orientation
/// uses the vehicle's world frame.
WorldFrame reference_world(const Trajectory& reference, WorldFrame vehicle_world);

/// The poses in [from, to].
Trajectory within(const Trajectory& trajectory, Stamp from, Stamp to);
/// The part of a reference that a run over part of a recording covers: `duration_s` seconds from
/// its first sample; 0: to the end.
Trajectory clip_to_run(const Trajectory& reference, Stamp first_sample, double duration_s);

/// The trajectory in a z-up world: north-east-down becomes east-north-up.
Trajectory to_z_up(const Trajectory& trajectory, WorldFrame world);

/// Time spans for a message: "the estimate spans 0.000 to 9.000 s, ...".
std::string describe_spans(const Trajectory& reference, const Trajectory& estimate);

}  // namespace apvi::eval
