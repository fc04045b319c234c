// SPDX-License-Identifier: BSD-3-Clause
#include "eval/trajectory_metrics.hpp"

#include <fmt/format.h>

#include <numbers>

#include "apvi/geometry/so3.hpp"
#include "eval/alignment.hpp"
#include "eval/relative_error.hpp"
#include "geometry/umeyama.hpp"

namespace apvi::eval {
namespace {

using Eigen::Vector3d;

// The associated trajectories, both in a z-up world.
struct Comparison {
  std::vector<PosePair> pairs;
  bool planar = false;
  bool oriented = true;

  double length_of(const Vector3d& v) const { return planar ? v.head<2>().norm() : v.norm(); }
};

Trajectory finite_part(const Trajectory& trajectory) {
  Trajectory finite = trajectory;
  std::erase_if(finite.poses, [](const StampedPose& pose) {
    const SE3& T = pose.T_world_body;
    return !T.translation.allFinite() || !T.rotation.coeffs().allFinite();
  });
  return finite;
}

bool overlap(const Trajectory& a, const Trajectory& b) {
  return !a.empty() && !b.empty() && a.poses.front().stamp <= b.poses.back().stamp &&
         b.poses.front().stamp <= a.poses.back().stamp;
}

ErrorMetric position_error(const Comparison& comparison, const SE3& T_reference_estimate) {
  std::vector<double> errors;
  for (const PosePair& pair : comparison.pairs) {
    errors.push_back(comparison.length_of(T_reference_estimate * pair.estimate.translation -
                                          pair.reference.translation));
  }
  return {summarize(std::move(errors))};
}

ErrorMetric rotation_error(const Comparison& comparison, const Fit& alignment) {
  if (!comparison.oriented) return {{}, Reason::no_orientation};
  if (!alignment.determined) return {{}, Reason::undetermined};
  std::vector<double> errors;
  for (const PosePair& pair : comparison.pairs) {
    const SE3 aligned = alignment.T_reference_estimate * pair.estimate;
    errors.push_back(so3::angle_between(pair.reference.rotation, aligned.rotation) * 180.0 /
                     std::numbers::pi);
  }
  return {summarize(std::move(errors))};
}

ErrorMetric relative_error(const Comparison& comparison, const IndexPairs& indices) {
  if (!comparison.oriented) return {{}, Reason::no_orientation};
  if (comparison.planar) return {{}, Reason::no_height};
  if (indices.empty()) return {{}, Reason::too_short};
  return {summarize(relative_errors(comparison.pairs, indices))};
}

double reference_length(const Comparison& comparison) {
  double length = 0.0;
  for (std::size_t i = 1; i < comparison.pairs.size(); ++i) {
    length += comparison.length_of(comparison.pairs[i].reference.translation -
                                   comparison.pairs[i - 1].reference.translation);
  }
  return length;
}

void fill_absolute(const Comparison& comparison, Alignment alignment, TrajectoryMetrics& metrics) {
  const auto fill = [&](Alignment mode, ErrorMetric& position, ErrorMetric* rotation) {
    if (mode == Alignment::first && !comparison.oriented) {
      position.reason = Reason::no_orientation;
      if (rotation != nullptr) rotation->reason = Reason::no_orientation;
      return;
    }
    const Fit aligned = fit(comparison.pairs, mode, comparison.planar);
    position = position_error(comparison, aligned.T_reference_estimate);
    if (rotation != nullptr) *rotation = rotation_error(comparison, aligned);
  };
  fill(alignment, metrics.ate, &metrics.rotation_deg);
  fill(Alignment::first, metrics.ate_first_pose, nullptr);
  metrics.path_length_m = reference_length(comparison);
  if (metrics.ate.value && *metrics.path_length_m > 0.0) {
    metrics.ate_percent_of_path = 100.0 * metrics.ate.value->rmse / *metrics.path_length_m;
  }
}

void fill_relative(const Comparison& comparison, TrajectoryMetrics& metrics) {
  const auto& pairs = comparison.pairs;
  metrics.rpe_time = relative_error(comparison, pairs_by_time(pairs, kRpeTime_s));
  metrics.rpe_distance =
      relative_error(comparison, consecutive_pairs_by_path(pairs, kRpeDistance_m));
  metrics.rpe_distance_all_pairs =
      relative_error(comparison, all_pairs_by_path(pairs, kRpeDistance_m));
}

// Scales the estimate; nullopt, and nothing changes, when positions do not determine the scale.
std::optional<double> scale_to_reference(Comparison& comparison) {
  std::vector<Vector3d> source;
  std::vector<Vector3d> target;
  for (const PosePair& pair : comparison.pairs) {
    source.push_back(pair.estimate.translation);
    target.push_back(pair.reference.translation);
  }
  const auto scale = similarity_scale(source, target);
  if (!scale) return std::nullopt;
  for (PosePair& pair : comparison.pairs) pair.estimate.translation *= *scale;
  return scale;
}

void set_reason(Reason reason, TrajectoryMetrics& metrics) {
  for (ErrorMetric* metric :
       {&metrics.ate, &metrics.ate_first_pose, &metrics.rotation_deg, &metrics.rpe_time,
        &metrics.rpe_distance, &metrics.rpe_distance_all_pairs}) {
    metric->reason = reason;
  }
}

}  // namespace

std::string_view to_string(Reason reason) {
  switch (reason) {
    case Reason::computed:
      return "computed";
    case Reason::no_overlap:
      return "no overlap in time";
    case Reason::too_few_matches:
      return "too few matches";
    case Reason::no_orientation:
      return "positions only";
    case Reason::no_height:
      return "planar reference";
    case Reason::undetermined:
      return "positions on a line";
    case Reason::too_short:
      return "path too short";
  }
  return "";
}

std::size_t min_matches(Alignment alignment) {
  return alignment == Alignment::se3 || alignment == Alignment::sim3 ? 3 : 2;
}

TrajectoryMetrics evaluate(const Trajectory& reference, const Trajectory& estimate,
                           const EvalOptions& options) {
  TrajectoryMetrics metrics = evaluate_without_reference(estimate);
  const Trajectory reference_up = to_z_up(finite_part(reference), options.reference_world);
  const Trajectory estimate_up = to_z_up(finite_part(estimate), options.estimate_world);
  Comparison comparison{.pairs = associate(reference_up, estimate_up, options.association),
                        .planar = !reference_up.has_height || !estimate_up.has_height,
                        .oriented = reference_up.has_rotation && estimate_up.has_rotation};
  metrics.matched = comparison.pairs.size();
  metrics.coverage = coverage(reference_up, estimate_up, options.association.max_gap_s);
  if (!overlap(reference_up, estimate_up)) {
    set_reason(Reason::no_overlap, metrics);
  } else if (comparison.pairs.size() < min_matches(options.alignment)) {
    set_reason(Reason::too_few_matches, metrics);
  } else {
    if (options.alignment == Alignment::sim3) {
      metrics.scale_to_reference = scale_to_reference(comparison);
    }
    fill_absolute(comparison, options.alignment, metrics);
    fill_relative(comparison, metrics);
  }
  return metrics;
}

TrajectoryMetrics evaluate_without_reference(const Trajectory& estimate) {
  TrajectoryMetrics metrics;
  const Trajectory finite = finite_part(estimate);
  if (finite.empty()) return metrics;
  metrics.end_to_start_m =
      (finite.poses.back().T_world_body.translation - finite.poses.front().T_world_body.translation)
          .norm();
  metrics.estimate_length_m = finite.path_length();
  return metrics;
}

WorldFrame reference_world(const Trajectory& reference, WorldFrame vehicle_world) {
  return reference.has_rotation ? vehicle_world : WorldFrame::up;
}

Trajectory within(const Trajectory& trajectory, Stamp from, Stamp to) {
  Trajectory part = trajectory;
  std::erase_if(part.poses,
                [&](const StampedPose& pose) { return pose.stamp < from || pose.stamp > to; });
  return part;
}

Trajectory clip_to_run(const Trajectory& reference, Stamp first_sample, double duration_s) {
  const Stamp end =
      duration_s > 0.0 ? first_sample + Duration::from_seconds(duration_s) : Stamp::max();
  return within(reference, first_sample, end);
}

Trajectory to_z_up(const Trajectory& trajectory, WorldFrame world) {
  Trajectory converted = trajectory;
  if (world == WorldFrame::up) return converted;
  // NED to ENU: rotation by 180 degrees about the north-east axis.
  const SE3 T_up_ned{
      Eigen::Quaterniond(0.0, std::numbers::sqrt2 / 2.0, std::numbers::sqrt2 / 2.0, 0.0),
      Vector3d::Zero()};
  for (StampedPose& pose : converted.poses) pose.T_world_body = T_up_ned * pose.T_world_body;
  return converted;
}

std::string describe_spans(const Trajectory& reference, const Trajectory& estimate) {
  if (reference.empty()) return "the reference has no poses";
  if (estimate.empty()) return "the estimate has no poses";
  const Stamp ref_begin = reference.poses.front().stamp;
  const Stamp ref_end = reference.poses.back().stamp;
  const Stamp est_begin = estimate.poses.front().stamp;
  const Stamp est_end = estimate.poses.back().stamp;
  std::string text =
      fmt::format("the estimate spans {:.3f} to {:.3f} s, the reference {:.3f} to {:.3f} s",
                  est_begin.seconds(), est_end.seconds(), ref_begin.seconds(), ref_end.seconds());
  const double apart =
      std::max(seconds_between(est_end, ref_begin), seconds_between(ref_end, est_begin));
  if (apart > 0.0) text += fmt::format(" ({:.3f} s apart)", apart);
  return text;
}

}  // namespace apvi::eval
