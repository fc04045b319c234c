// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "localization/fusion_stage.hpp"
#include "loop_closure/keyframe_graph.hpp"

namespace apvi::localization {

/// How far the fused trajectory may have drifted, by what its estimators report.
///
/// While VIO gives the pose, its drift is a random walk with the covariance of the motion over the
/// window, which does not depend on what the absolute pose is known from. Otherwise it is the
/// change of the covariance of the fused pose; dead reckoning and measurements both move the pose,
/// so absolute changes count. The error that the poses of a segment share counts once, where the
/// segment begins.
class OdometryDrift {
 public:
  /// Every frame, in order of time.
  void add(const FrameOutput& output);
  /// Drift since the last call. If VIO has begun anew in between, at least the change of the fused
  /// covariance, and what a vehicle may move in a span without any pose.
  loop_closure::DriftVariance take(bool vio_continues);
  /// Standard deviation of the height [m]; zero before the first pose.
  double height_sigma_m() const;

 private:
  loop_closure::DriftVariance since_;
  std::optional<fusion::PoseEstimate> last_;
  std::optional<fusion::PoseEstimate> at_take_;
  Stamp stamp_;
  double gap_s_ = 0.0;  // longest time without a pose before one by VIO, since `take`
};

}  // namespace apvi::localization
