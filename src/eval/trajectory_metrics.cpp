// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/eval/trajectory_metrics.hpp"

#include <fmt/format.h>

#include <numbers>

#include "alignment.hpp"
#include "apvi/geometry/so3.hpp"
#include "relative_error.hpp"

namespace apvi::eval {
namespace {

using Eigen::Vector3d;

// What is compared, both in a world with z up.
struct Problem {
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

Figure position_error(const Problem& problem, const SE3& T_reference_estimate) {
  std::vector<double> errors;
  for (const PosePair& pair : problem.pairs) {
    errors.push_back(problem.length_of(T_reference_estimate * pair.estimate.translation -
                                       pair.reference.translation));
  }
  return {summarize(std::move(errors))};
}

Figure rotation_error(const Problem& problem, const Fit& alignment) {
  if (!problem.oriented) return {{}, Reason::no_orientation};
  if (!alignment.determined) return {{}, Reason::undetermined};
  std::vector<double> errors;
  for (const PosePair& pair : problem.pairs) {
    const SE3 aligned = alignment.T_reference_estimate * pair.estimate;
    errors.push_back(so3::angle_between(pair.reference.rotation, aligned.rotation) * 180.0 /
                     std::numbers::pi);
  }
  return {summarize(std::move(errors))};
}

Figure relative_error(const Problem& problem, const IndexPairs& indices) {
  if (!problem.oriented) return {{}, Reason::no_orientation};
  if (problem.planar) return {{}, Reason::no_height};
  if (indices.empty()) return {{}, Reason::too_short};
  return {summarize(relative_errors(problem.pairs, indices))};
}

double reference_length(const Problem& problem) {
  double length = 0.0;
  for (std::size_t i = 1; i < problem.pairs.size(); ++i) {
    length += problem.length_of(problem.pairs[i].reference.translation -
                                problem.pairs[i - 1].reference.translation);
  }
  return length;
}

void fill_absolute(const Problem& problem, Alignment alignment, TrajectoryMetrics& metrics) {
  const auto figures = [&](Alignment mode, Figure& position, Figure* rotation) {
    if (mode == Alignment::first && !problem.oriented) {
      position.reason = Reason::no_orientation;
      if (rotation != nullptr) rotation->reason = Reason::no_orientation;
      return;
    }
    const Fit aligned = fit(problem.pairs, mode, problem.planar);
    position = position_error(problem, aligned.T_reference_estimate);
    if (rotation != nullptr) *rotation = rotation_error(problem, aligned);
  };
  figures(alignment, metrics.ate, &metrics.rotation_deg);
  figures(Alignment::first, metrics.ate_first_pose, nullptr);
  metrics.path_length_m = reference_length(problem);
  if (metrics.ate.value && *metrics.path_length_m > 0.0) {
    metrics.ate_percent_of_path = 100.0 * metrics.ate.value->rmse / *metrics.path_length_m;
  }
}

void fill_relative(const Problem& problem, TrajectoryMetrics& metrics) {
  const auto& pairs = problem.pairs;
  metrics.rpe_time = relative_error(problem, pairs_by_time(pairs, kRelativeTime));
  metrics.rpe_distance =
      relative_error(problem, consecutive_pairs_by_path(pairs, kRelativeDistance));
  metrics.rpe_distance_all_pairs =
      relative_error(problem, all_pairs_by_path(pairs, kRelativeDistance));
}

void give_up(Reason reason, TrajectoryMetrics& metrics) {
  for (Figure* figure :
       {&metrics.ate, &metrics.ate_first_pose, &metrics.rotation_deg, &metrics.rpe_time,
        &metrics.rpe_distance, &metrics.rpe_distance_all_pairs}) {
    figure->reason = reason;
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

std::size_t needed_matches(Alignment alignment) {
  return alignment == Alignment::se3 ? 3 : 2;
}

TrajectoryMetrics evaluate(const Trajectory& reference, const Trajectory& estimate,
                           const EvalOptions& options) {
  TrajectoryMetrics metrics = evaluate_alone(estimate);
  const Trajectory truth = to_z_up(finite_part(reference), options.reference_world);
  const Trajectory guess = to_z_up(finite_part(estimate), options.estimate_world);
  const Problem problem{.pairs = associate(truth, guess, options.association),
                        .planar = !truth.has_height || !guess.has_height,
                        .oriented = truth.has_rotation && guess.has_rotation};
  metrics.matched = problem.pairs.size();
  metrics.coverage = coverage(truth, guess, options.association.max_gap_s);
  if (!overlap(truth, guess)) {
    give_up(Reason::no_overlap, metrics);
  } else if (problem.pairs.size() < needed_matches(options.alignment)) {
    give_up(Reason::too_few_matches, metrics);
  } else {
    fill_absolute(problem, options.alignment, metrics);
    fill_relative(problem, metrics);
  }
  return metrics;
}

TrajectoryMetrics evaluate_alone(const Trajectory& estimate) {
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

Trajectory seen_part(const Trajectory& reference, Stamp first_sample, double duration_s) {
  const Stamp end =
      duration_s > 0.0 ? first_sample + Duration::from_seconds(duration_s) : Stamp::max();
  return within(reference, first_sample, end);
}

Trajectory to_z_up(const Trajectory& trajectory, WorldFrame world) {
  Trajectory turned = trajectory;
  if (world == WorldFrame::up) return turned;
  // East, north, up in terms of north, east, down: half a turn about the axis north-east.
  const SE3 T_up_ned{
      Eigen::Quaterniond(0.0, std::numbers::sqrt2 / 2.0, std::numbers::sqrt2 / 2.0, 0.0),
      Vector3d::Zero()};
  for (StampedPose& pose : turned.poses) pose.T_world_body = T_up_ned * pose.T_world_body;
  return turned;
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
