// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>
#include <string_view>

#include "apvi/core/stamp.hpp"
#include "apvi/fusion/config.hpp"
#include "dipo/dipo.hpp"
#include "fusion/pose_estimate.hpp"

namespace apvi::fusion {

enum class StabilityReason {
  stable,
  absent,  ///< no DIPO in this run, or not initialized
  not_finite,
  no_ping,             ///< no ping used yet
  dvl_old,             ///< measured [s]
  innovations,         ///< measured: median NIS per degree of freedom
  rotation_uncertain,  ///< measured: sigma [deg]
  position_uncertain,  ///< measured: sigma [m]
  position_growing,    ///< measured [m/s]
};
std::string_view to_string(StabilityReason reason);

struct Stability {
  StabilityReason reason = StabilityReason::absent;
  double measured = 0.0;
  double threshold = 0.0;

  bool stable() const { return reason == StabilityReason::stable; }
};

/// Tests whether DIPO is stable enough to navigate without VIO: "outlier rejection and the
/// properties of its Hessian matrix" in the paper; here the NIS of the last pings, the age of the
/// last ping used, and the covariance. The position sigma is unbounded in dead reckoning, so its
/// growth rate is tested.
class DipoStability {
 public:
  explicit DipoStability(const StabilityConfig& config) : config_(config) {}

  /// Reports the outcome of a DVL ping.
  void add(const dipo::Report& ping);
  /// Evaluates the stability at a frame; stamps must not decrease.
  Stability check(Stamp now, const std::optional<PoseEstimate>& dipo);

 private:
  struct PastSigma {
    Stamp stamp;
    double position = 0.0;  // [m]
  };
  Stability check_pings(Stamp now) const;
  Stability check_covariance(Stamp now, const PoseEstimate& dipo);

  StabilityConfig config_;
  std::deque<double> nis_;  // per degree of freedom
  std::optional<Stamp> last_used_;
  std::deque<PastSigma> sigmas_;
};

}  // namespace apvi::fusion
