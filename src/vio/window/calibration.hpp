// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/vio/config.hpp"
#include "vio/marginalization/marginalization.hpp"
#include "vio/window/frame_state.hpp"

/// The sensors' calibration as the window estimates it, starting from the rig.
namespace apvi::vio {

struct Calibration {
  std::vector<PoseBlock> T_body_camera;
  std::vector<LensBlock> lenses;      ///< by camera
  double camera_time_offset_s = 0.0;  ///< in addition to the rig's value
  bool has_dvl = false;
  PoseBlock T_body_dvl{0, 0, 0, 0, 0, 0, 1};
  double dvl_log_scale = 0.0;  ///< logarithm of the true over the measured velocity
};

/// A number, rotation or vector of a calibration and what is known about it.
struct CalibrationParameter {
  std::string name;        ///< "cam0.mounting", "cam0.lever_arm", "cam0.time_offset_s", ...
  Eigen::VectorXd change;  ///< from the rig's value; rotations in the sensor's frame [rad]
  Eigen::VectorXd sigma;
  double prior_sigma = 0.0;  ///< of each component
  bool held = false;         ///< the rig's value is in use, see CalibrationHold

  /// Whether the measurements told more than the prior, in every component.
  bool observable() const { return sigma.maxCoeff() < 0.5 * prior_sigma; }
};

Calibration calibration_of(const Rig& rig);
/// The rig with the window's calibration; a lens keeps its distortion.
Rig calibrated(Rig rig, const Calibration& calibration);

/// A parameter block of a calibration.
struct CalibrationBlock {
  Block block;
  bool estimate = false;
};
std::vector<CalibrationBlock> blocks(Calibration& calibration, const CalibrationConfig& config);

/// The knowledge about the estimated blocks before the first measurement: that of the rig, centered
/// on the current values. Empty if nothing is estimated.
Prior calibration_prior(Calibration& calibration, const CalibrationConfig& config);
/// What `prior` knows about the calibration alone, at its current values; its other states are
/// marginalized. Empty if it does not know all estimated blocks.
Prior calibration_part(const std::shared_ptr<const Prior>& prior,
                       const std::vector<CalibrationBlock>& calibration);
/// Both priors as one; they must not share a block.
Prior joined(const Prior& a, const Prior& b);

/// What the window has learned, for a window that starts anew. A window that fails may have learned
/// wrongly in its last seconds: these are forgotten.
class CalibrationMemory {
 public:
  CalibrationMemory(Calibration& calibration, const CalibrationConfig& config);

  /// Keeps the knowledge of the window's prior, every few seconds.
  void update(Stamp now, const std::shared_ptr<const Prior>& prior, const Calibration& values,
              const std::vector<CalibrationBlock>& blocks);
  /// Sets the calibration back to what is remembered.
  void restore(Calibration& calibration);
  /// At the values of the last `restore`, or of the construction.
  const Prior& knowledge() const { return before_.knowledge; }

 private:
  struct Snapshot {
    std::optional<Stamp> stamp;
    Calibration values;
    Prior knowledge;
  };

  Snapshot before_, latest_;
};

/// Estimated parameters and their joint covariance: square, the components of all parameters in
/// order.
struct CalibrationEstimate {
  std::vector<CalibrationParameter> parameters;
  Eigen::MatrixXd covariance;
};

/// The estimated parameters: the values that `knowledge` (of calibration_prior, calibration_part or
/// calibration_knowledge) makes most likely.
CalibrationEstimate estimate_of(const Calibration& calibration, const Rig& rig,
                                const CalibrationConfig& config, const Prior& knowledge);
/// The inverse of `estimate_of`: the calibration that differs from the rig by the parameters'
/// changes. Ignores names that it does not know.
Calibration with_changes(const Rig& rig, const std::vector<CalibrationParameter>& parameters);

/// The point on the plane z = 1 of a true lens.
inline Eigen::Vector2d true_point(const Eigen::Vector2d& point, const LensBlock& lens) {
  return (point - Eigen::Vector2d(lens[1], lens[2])) / std::exp(lens[0]);
}

}  // namespace apvi::vio
