// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/fusion/dipo_stability.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace apvi::fusion {
namespace {

constexpr std::array<std::string_view, 9> kReasons{
    "stable",          "absent",      "not_finite",         "no_ping",
    "dvl_old",         "innovations", "rotation_uncertain", "position_uncertain",
    "position_growing"};
static_assert(kReasons.size() == static_cast<std::size_t>(StabilityReason::position_growing) + 1);

// One sigma of the worst direction of a block.
double worst_sigma(const Matrix6& covariance, int at) {
  const Eigen::Matrix3d block = symmetric(covariance).block<3, 3>(at, at);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(block, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues()(2)));
}

}  // namespace

std::string_view to_string(StabilityReason reason) {
  return kReasons.at(static_cast<std::size_t>(reason));
}

void DipoStability::add(const dipo::Report& ping) {
  using dipo::Verdict;
  const bool used = ping.verdict == Verdict::accepted || ping.verdict == Verdict::weakened;
  if (used && (!last_used_ || ping.stamp > *last_used_)) last_used_ = ping.stamp;
  if (ping.rows < 1 || !(used || ping.verdict == Verdict::rejected)) return;
  nis_.push_back(ping.nis / ping.rows);
  if (nis_.size() > static_cast<std::size_t>(config_.nis_pings)) nis_.pop_front();
}

Stability DipoStability::check(Stamp now, const std::optional<PoseEstimate>& dipo) {
  if (!dipo) return {StabilityReason::absent};
  if (!is_finite(*dipo)) return {StabilityReason::not_finite};
  // The covariance is looked at in any case: its past must have no holes.
  const Stability covariance = check_covariance(now, dipo->covariance);
  const Stability pings = check_pings(now);
  return pings.stable() ? covariance : pings;
}

Stability DipoStability::check_pings(Stamp now) const {
  if (!last_used_) return {StabilityReason::no_ping};
  const double age = seconds_between(*last_used_, now);
  if (age > config_.max_dvl_age_s) return {StabilityReason::dvl_old, age, config_.max_dvl_age_s};
  if (!nis_.empty()) {
    const double mean =
        std::accumulate(nis_.begin(), nis_.end(), 0.0) / static_cast<double>(nis_.size());
    if (!(mean <= config_.max_nis)) return {StabilityReason::innovations, mean, config_.max_nis};
  }
  return {StabilityReason::stable};
}

Stability DipoStability::check_covariance(Stamp now, const Matrix6& covariance) {
  const double rotation = worst_sigma(covariance, 0) / kRadiansPerDegree;
  const double position = worst_sigma(covariance, 3);
  sigmas_.push_back({now, position});
  const Duration window = Duration::from_seconds(config_.growth_window_s);
  while (sigmas_.size() > 2 && now - sigmas_[1].stamp >= window) sigmas_.pop_front();
  if (rotation > config_.max_rotation_sigma_deg) {
    return {StabilityReason::rotation_uncertain, rotation, config_.max_rotation_sigma_deg};
  }
  if (config_.max_position_sigma_m > 0.0 && position > config_.max_position_sigma_m) {
    return {StabilityReason::position_uncertain, position, config_.max_position_sigma_m};
  }
  const Duration span = now - sigmas_.front().stamp;
  if (span >= window) {
    const double growth = (position - sigmas_.front().position) / span.seconds();
    if (growth > config_.max_position_growth) {
      return {StabilityReason::position_growing, growth, config_.max_position_growth};
    }
  }
  return {StabilityReason::stable};
}

}  // namespace apvi::fusion
