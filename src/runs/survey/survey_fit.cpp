// SPDX-License-Identifier: BSD-3-Clause
#include "runs/survey/survey_fit.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "apvi/core/constants.hpp"
#include "apvi/core/error.hpp"
#include "geometry/umeyama.hpp"

namespace apvi::runs {
namespace {

constexpr Duration kMaxGap{1000000000};

/// Positions of both at the same stamps.
struct Pairs {
  std::vector<Eigen::Vector3d> ours;
  std::vector<Eigen::Vector3d> theirs;
};

Pairs pairs_of(const Trajectory& trajectory, const Trajectory& positions, const SE3& T_level) {
  Pairs pairs;
  for (const StampedPose& fix : positions.poses) {
    const auto pose = trajectory.at(fix.stamp, kMaxGap);
    if (!pose) continue;
    pairs.ours.push_back(T_level * pose->translation);
    pairs.theirs.push_back(fix.T_world_body.translation);
    if (!positions.has_height) pairs.theirs.back().z() = pairs.ours.back().z();
  }
  return pairs;
}

void add_residuals(const Pairs& pairs, const SE3& T, FittedGeoreference& fit) {
  double sum = 0.0;
  for (std::size_t i = 0; i < pairs.ours.size(); ++i) {
    const double residual = (T * pairs.ours[i] - pairs.theirs[i]).head<2>().norm();
    sum += residual * residual;
    fit.horizontal_max_m = std::max(fit.horizontal_max_m, residual);
  }
  fit.fixes = pairs.ours.size();
  fit.horizontal_rms_m = std::sqrt(sum / static_cast<double>(fit.fixes));
}

}  // namespace

FittedGeoreference fit_georeference(const Trajectory& trajectory, const Trajectory& positions,
                                    const std::optional<int>& epsg, bool z_down) {
  const survey::Georeference level = survey::georeference({.epsg = epsg}, z_down);
  const Pairs pairs = pairs_of(trajectory, positions, level.T_crs_world);
  const auto T = align_yaw(pairs.ours, pairs.theirs);
  if (!T) {
    fail_input("--positions: {} of {} positions lie within the run; two distinct ones are needed",
               pairs.ours.size(), positions.size());
  }
  FittedGeoreference fit{.reference = {epsg, *T * level.T_crs_world}};
  const Eigen::Vector3d x = fit.reference.T_crs_world.rotation * Eigen::Vector3d::UnitX();
  fit.heading_deg = std::atan2(x.x(), x.y()) * kDegreesPerRadian;
  add_residuals(pairs, *T, fit);
  return fit;
}

}  // namespace apvi::runs
