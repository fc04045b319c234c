// SPDX-License-Identifier: BSD-3-Clause
#include "runs/live/live_poses.hpp"

#include "imu/propagation.hpp"

namespace apvi::runs {
namespace {

using fusion::FusionState;

constexpr Duration kPingMemory{3'000'000'000};
// After a pause of the poses a new segment may have begun.
constexpr Duration kPause{2'000'000'000};

bool is_used(dipo::Verdict verdict) {
  return verdict == dipo::Verdict::accepted || verdict == dipo::Verdict::downweighted;
}

bool is_trusted(const localization::FrameOutput& output) {
  const FusionState state = output.fusion.state;
  return state != FusionState::dropped && state != FusionState::waiting && !output.is_up_to_scale();
}

}  // namespace

unsigned LivePoses::count_resets(Stamp stamp, bool jumps) {
  if (last_ && (jumps || stamp - *last_ > kPause)) ++resets_;
  last_ = stamp;
  return resets_;
}

std::optional<live::PoseOutput> LivePoses::of(const localization::FrameOutput& output) {
  const auto& pose = output.fusion.pose;
  if (!pose) return std::nullopt;
  const bool jumps = output.scale_found || !output.vio.earlier.empty();
  live::PoseOutput live{.stamp = output.stamp,
                        .T_world_body = pose->T_world_body,
                        .v_body = std::nullopt,
                        .covariance = pose->covariance,
                        .resets = count_resets(output.stamp, jumps),
                        .trusted = is_trusted(output)};
  const FusionState state = output.fusion.state;
  const bool by_vio = state == FusionState::fused || state == FusionState::vio_only;
  if (by_vio && output.vio.has_state()) live.v_body = output.vio.state.v_body;
  return live;
}

live::PoseOutput LivePoses::of(const localization::PingOutput& output) {
  const dipo::Estimate& estimate = output.estimate;
  if (is_used(output.ping.verdict)) last_used_ping_ = estimate.stamp;
  const imu::NavState& nav = estimate.state.nav;
  return {.stamp = estimate.stamp,
          .T_world_body = nav.pose(),
          .v_body = nav.v_body,
          .covariance = estimate.covariance.topLeftCorner<6, 6>() + estimate.segment_covariance,
          .resets = count_resets(estimate.stamp, false),
          .trusted = last_used_ping_ && estimate.stamp - *last_used_ping_ <= kPingMemory};
}

}  // namespace apvi::runs
