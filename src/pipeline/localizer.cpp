// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/localizer.hpp"

#include "apvi/core/log.hpp"
#include "apvi/core/stopwatch.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi::pipeline {
namespace {

SE3 pose_of(const imu::NavState& state) {
  return {state.R_world_body, state.p_world};
}

fusion::PoseEstimate estimate_of(const vio::Aid& aid) {
  return {pose_of(aid.state), aid.covariance.topLeftCorner<6, 6>()};
}

fusion::VioEstimate estimate_of(const vio::Result& result) {
  fusion::VioEstimate vio;
  vio.T_world_body = pose_of(result.state);
  vio.information = result.information;
  if (result.window_s > 0.0) vio.window_information = result.window_information;
  vio.window_s = result.window_s;
  vio.inliers = result.landmarks;
  return vio;
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
      estimator_(vio, rig),
      fuser_(fusion, freeze) {}

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
  const std::optional<vio::Aid> dipo = moved(job.dipo);
  if (!tracked) {
    output.dropped = true;
    if (dipo) output.dipo = pose_of(dipo->state);
    return output;
  }
  output.statistics = tracked->statistics;
  const bool aided = allow_aid_ || !vio_start_s_;
  output.vio = estimator_.process(*tracked, aided ? dipo : std::nullopt);
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
  if (const auto here = moved(job.dipo)) {
    input.dipo = estimate_of(*here);
    output.dipo = input.dipo->T_world_body;
  }
  if (output.vio.has_state()) input.vio = estimate_of(output.vio);
  output.fusion = fuser_.update(input);
  act(output.fusion.freeze.action);
  output.timing.solve_s = output.vio.solve_s;
  output.timing.information_s = output.vio.information_s;
  output.timing.marginalize_s = output.vio.marginalize_s;
  output.timing.localize_s = watch.seconds();
  return output;
}

// Everything of DIPO's but its world stays: velocity and biases are the body's.
std::optional<vio::Aid> Localizer::moved(const std::optional<vio::Aid>& dipo) const {
  if (!dipo || !T_output_dipo_) return dipo;
  vio::Aid aid = *dipo;
  const SE3 pose = *T_output_dipo_ * pose_of(dipo->state);
  aid.state.R_world_body = pose.rotation;
  aid.state.p_world = pose.translation;
  const Eigen::Matrix3d R = T_output_dipo_->rotation.toRotationMatrix();
  aid.covariance.middleRows<3>(imu::kPosition).applyOnTheLeft(R);
  aid.covariance.middleCols<3>(imu::kPosition).applyOnTheRight(R.transpose());
  return aid;
}

void Localizer::align(const vio::Aid& dipo, const vio::Result& vio, bool vio_was_first) {
  if (!vio_was_first) {
    T_output_dipo_ = SE3::identity();
    return;
  }
  const SE3 here = pose_of(vio.state);
  const SE3 there = pose_of(dipo.state);
  const Eigen::Quaterniond difference = here.rotation * there.rotation.conjugate();
  const SE3 turn{so3::exp(Eigen::Vector3d(0.0, 0.0, so3::yaw(difference))),
                 Eigen::Vector3d::Zero()};
  T_output_dipo_ = SE3{turn.rotation, here.translation - turn * there.translation};
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
