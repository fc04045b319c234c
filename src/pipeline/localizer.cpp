// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/localizer.hpp"

#include "apvi/core/log.hpp"
#include "apvi/core/stopwatch.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi::pipeline {
namespace {

fusion::PoseEstimate estimate_of(const vio::Aid& aid) {
  return {aid.state.pose(), aid.covariance.topLeftCorner<6, 6>()};
}

fusion::VioEstimate estimate_of(const vio::Result& result) {
  fusion::VioEstimate vio;
  vio.T_world_body = result.state.pose();
  vio.information = result.information;
  if (result.window_s > 0.0) vio.window_information = result.window_information;
  vio.window_s = result.window_s;
  vio.inliers = result.landmarks;
  return vio;
}

fusion::Config for_camera(fusion::Config config, const Rig& rig) {
  if (rig.cameras.empty()) return config;
  fusion::FineConfig& fine = config.discriminator.fine;
  fine = fusion::for_camera(fine, rig.cameras.front().model.parameters().fx);
  return config;
}

}  // namespace

std::optional<StampedPose> FrameOutput::fused() const {
  if (!fusion.pose) return std::nullopt;
  return StampedPose{stamp, fusion.pose->T_world_body};
}

Localizer::Localizer(const vio::Config& vio, const fusion::Config& fusion,
                     const fusion::FreezeConfig& freeze, const Rig& rig)
    // The baseline without freezing starts anew as a system without DVL has to.
    : tight_(vio.graph == vio::GraphKind::tight && rig.dvl),
      allow_aid_(freeze.enabled || tight_),
      follow_drift_(fusion.discriminator.medium.window_s > 0.0),
      estimator_(vio, rig),
      fuser_(for_camera(fusion, rig), freeze) {}

FrameOutput Localizer::process(const FrameJob& job,
                               const std::optional<vio::TrackedFrame>& tracked) {
  const Stopwatch watch;
  if (!first_frame_) first_frame_ = job.stamp;
  for (const ImuSample& sample : job.imu) estimator_.add(sample);
  for (const vio::DvlMeasurement& ping : job.pings) estimator_.add(ping);
  for (const vio::DepthMeasurement& depth : job.depths) estimator_.add(depth);
  for (const dipo::Report& report : job.reports) fuser_.add(report);

  FrameOutput output;
  output.stamp = job.stamp;
  const std::optional<vio::Aid> dipo = in_world(job.dipo);
  if (!tracked) {
    output.dropped = true;
    if (dipo) output.dipo = dipo->state.pose();
    return output;
  }
  output.statistics = tracked->statistics;
  const bool aided = allow_aid_ || !vio_start_s_;
  std::optional<vio::Aid> aid;
  if (dipo) aid = vio::moved(T_vio_dipo_, *dipo);
  output.vio = aided && aid ? estimator_.process(*tracked, aid)
                            : estimator_.process(*tracked, std::nullopt, place(aid));
  if (output.vio.status == vio::Status::lost) {
    log::warning("vision lost at {:.2f} s: {}", seconds_between(*first_frame_, job.stamp),
                 output.vio.detail);
  }
  if (output.vio.has_state() && !vio_start_s_) {
    vio_start_s_ = seconds_between(*first_frame_, job.stamp);
  }
  if (job.dipo && !T_output_dipo_) {
    const bool took_over = output.vio.status == vio::Status::started && aided;
    align(*job.dipo, output.vio, output.vio.has_state() && !took_over);
  }
  fusion::FusionInput input;
  input.stamp = job.stamp;
  input.statistics = output.statistics;
  input.vio_includes_dipo = tight_;
  if (const auto here = in_world(job.dipo)) {
    input.dipo = estimate_of(*here);
    output.dipo = input.dipo->T_world_body;
  }
  if (output.vio.has_state()) input.vio = estimate_of(output.vio);
  output.fusion = fuser_.update(input);
  follow_drift(input, output);
  act(output.fusion.freeze.action);
  output.timing.solve_s = output.vio.solve_s;
  output.timing.information_s = output.vio.information_s;
  output.timing.marginalize_s = output.vio.marginalize_s;
  output.timing.localize_s = watch.seconds();
  return output;
}

std::optional<vio::Aid> Localizer::in_world(const std::optional<vio::Aid>& dipo) const {
  if (!dipo || !T_output_dipo_) return dipo;
  return vio::moved(*T_output_dipo_, *dipo);
}

void Localizer::align(const vio::Aid& dipo, const vio::Result& vio, bool vio_was_first) {
  T_output_dipo_ = SE3::identity();
  if (!vio_was_first) return;
  T_output_dipo_ = vio::level_alignment(vio.state.pose(), dipo.state.pose());
}

// Where a start without an aid goes on.
std::optional<SE3> Localizer::place(const std::optional<vio::Aid>& dipo) const {
  return dipo ? dipo->state.pose() : last_pose_;
}

// What both have drifted apart since they agreed to begin with must not shift a window that DIPO
// carries over or starts anew: what VIO has held and told lies where VIO was.
void Localizer::follow_drift(const fusion::FusionInput& input, const FrameOutput& output) {
  if (output.fusion.pose) last_pose_ = output.fusion.pose->T_world_body;
  if (!follow_drift_ || output.fusion.state != fusion::FusionState::fused) return;
  T_vio_dipo_ = vio::level_alignment(input.vio->T_world_body, input.dipo->T_world_body);
}

void Localizer::act(fusion::Action action) {
  switch (action) {
    case fusion::Action::none:
      return;
    case fusion::Action::freeze:
      return estimator_.freeze();
    case fusion::Action::release:
      return estimator_.release();
    case fusion::Action::reset:
      return estimator_.reset();
  }
}

}  // namespace apvi::pipeline
