// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <set>
#include <string>
#include <vector>

#include "vio/window/calibration.hpp"

namespace apvi::vio {

/// Holds each parameter at the rig's value until the measurements contradict that value. What a
/// dive tells about a calibration is weak at first, and errors of tracked corners last for seconds,
/// so that free parameters wander by several of their standard deviations: on a rig that is right,
/// that bends the path more than it helps.
class CalibrationHold {
 public:
  /// The estimated parameters, at their present values. Of the DVL's scale only if `rig` corrects
  /// it by a measured speed of sound.
  CalibrationHold(Calibration& calibration, const CalibrationConfig& config, const Rig& rig);

  bool holds(const std::string& name) const { return held_.contains(name); }
  bool holds_any() const { return !held_.empty(); }
  /// Pulls the held parameters to their values; null when there are none. Never marginalized.
  const std::shared_ptr<const Prior>& prior() const { return prior_; }
  /// Releases those whose estimate, without this class, differs from the rig by more than
  /// `release_sigmas`; all, if one differs by more than 1.5 times that. Part of the uncertainty of
  /// the rig counts as error of the estimate, because errors of the model do not average out.
  void update(const std::vector<CalibrationParameter>& estimates);

 private:
  void build_prior();

  Calibration* calibration_;  ///< of the window
  CalibrationConfig config_;
  Calibration rig_values_;
  std::set<std::string> held_;
  std::shared_ptr<const Prior> prior_;
};

}  // namespace apvi::vio
