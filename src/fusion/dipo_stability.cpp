// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/dipo_stability.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "core/median.hpp"

namespace apvi::fusion {
namespace {

constexpr std::array<std::string_view, 9> kReasons{
    "stable",          "absent",      "not_finite",         "no_ping",
    "dvl_old",         "innovations", "rotation_uncertain", "position_uncertain",
    "position_growing"};
static_assert(kReasons.size() == static_cast<std::size_t>(StabilityReason::position_growing) + 1);

// Standard deviation along the direction of largest variance.
template <int N>
double worst_sigma(const Eigen::Matrix<double, N, N>& covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, N, N>> solver(covariance,
                                                                          Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues()(N - 1)));
}

// About the horizontal axes of the world.
double tilt_sigma(const PoseEstimate& dipo) {
  return worst_sigma<2>(world_rotation_covariance(dipo).topLeftCorner<2, 2>());
}

// Robust to single rejected outliers.
double median_of(const std::deque<double>& values) {
  return median(std::vector<double>(values.begin(), values.end()));
}

}  // namespace

std::string_view to_string(StabilityReason reason) {
  return kReasons.at(static_cast<std::size_t>(reason));
}

void DipoStability::add(const dipo::Report& ping) {
  using dipo::Verdict;
  const bool used = ping.verdict == Verdict::accepted || ping.verdict == Verdict::downweighted;
  if (used && (!last_used_ || ping.stamp > *last_used_)) last_used_ = ping.stamp;
  if (ping.rows < 1 || !(used || ping.verdict == Verdict::rejected)) return;
  nis_.push_back(ping.nis / ping.rows);
  if (nis_.size() > static_cast<std::size_t>(config_.nis_window_pings)) nis_.pop_front();
}

Stability DipoStability::check(Stamp now, const std::optional<PoseEstimate>& dipo) {
  if (!dipo) return {StabilityReason::absent};
  if (!is_finite(*dipo)) return {StabilityReason::not_finite};
  // Always evaluated, so that the history of sigmas has no gaps.
  const Stability covariance = check_covariance(now, *dipo);
  const Stability pings = check_pings(now);
  return pings.stable() ? covariance : pings;
}

Stability DipoStability::check_pings(Stamp now) const {
  if (!last_used_) return {StabilityReason::no_ping};
  const double age = seconds_between(*last_used_, now);
  if (age > config_.max_dvl_age_s) return {StabilityReason::dvl_old, age, config_.max_dvl_age_s};
  if (!nis_.empty()) {
    const double median_nis = median_of(nis_);
    if (!(median_nis <= config_.max_median_nis))
      return {StabilityReason::innovations, median_nis, config_.max_median_nis};
  }
  return {StabilityReason::stable};
}

Stability DipoStability::check_covariance(Stamp now, const PoseEstimate& dipo) {
  const double rotation = tilt_sigma(dipo) / kRadiansPerDegree;
  const double position = worst_sigma<3>(symmetric(dipo.covariance).bottomRightCorner<3, 3>());
  sigmas_.push_back({now, position});
  const Duration window = Duration::from_seconds(config_.growth_window_s);
  while (sigmas_.size() > 2 && now - sigmas_[1].stamp >= window) sigmas_.pop_front();
  if (rotation > config_.max_tilt_sigma_deg) {
    return {StabilityReason::rotation_uncertain, rotation, config_.max_tilt_sigma_deg};
  }
  if (config_.max_position_sigma_m > 0.0 && position > config_.max_position_sigma_m) {
    return {StabilityReason::position_uncertain, position, config_.max_position_sigma_m};
  }
  const Duration span = now - sigmas_.front().stamp;
  if (span >= window) {
    const double growth = (position - sigmas_.front().position) / span.seconds();
    if (growth > config_.max_position_sigma_growth_m_s) {
      return {StabilityReason::position_growing, growth, config_.max_position_sigma_growth_m_s};
    }
  }
  return {StabilityReason::stable};
}

}  // namespace apvi::fusion
