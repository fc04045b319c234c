// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "live/pose_output.hpp"
#include "localization/acoustic_odometry.hpp"
#include "localization/fusion_stage.hpp"

namespace apvi::runs {

/// The poses of a run as a vehicle's controller needs them: with uncertainty, whether they can be
/// trusted, and how often they have jumped.
///
/// A pose of a frame is trusted unless vision has failed while DIPO is unstable, or its scale is
/// unknown. A pose of a ping is trusted while pings of the last three seconds were used.
class LivePoses {
 public:
  /// nullopt before initialization.
  std::optional<live::PoseOutput> of(const localization::FrameOutput& output);
  live::PoseOutput of(const localization::PingOutput& output);

 private:
  unsigned count_resets(Stamp stamp, bool jumps);

  std::optional<Stamp> last_;
  std::optional<Stamp> last_used_ping_;
  unsigned resets_ = 0;
};

}  // namespace apvi::runs
