// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>
#include <string_view>

#include "apvi/core/stamp.hpp"
#include "apvi/dipo/dipo.hpp"
#include "apvi/fusion/config.hpp"
#include "apvi/fusion/pose_estimate.hpp"

namespace apvi::fusion {

enum class StabilityReason {
  stable,
  absent,  ///< no DIPO in this run, or not started
  not_finite,
  no_ping,             ///< none has been used yet
  dvl_old,             ///< measured [s]
  innovations,         ///< measured: mean NIS per degree of freedom
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

/// Whether DIPO can carry the vehicle alone: "outlier rejection and the properties of its Hessian
/// matrix" in the paper; here the last pings' NIS, the age of the last one used, and the
/// covariance. Position sigma has no bound in dead reckoning; how fast it grows has.
class DipoStability {
 public:
  explicit DipoStability(const StabilityConfig& config) : config_(config) {}

  /// What became of a DVL ping.
  void add(const dipo::Report& ping);
  /// At a frame; stamps must not go back.
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
