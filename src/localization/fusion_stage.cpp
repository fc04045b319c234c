// SPDX-License-Identifier: BSD-3-Clause
#include "localization/fusion_stage.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "apvi/core/log.hpp"
#include "apvi/geometry/so3.hpp"
#include "core/stopwatch.hpp"

namespace apvi::localization {
namespace {

fusion::PoseEstimate estimate_of(const vio::StatePrior& prior) {
  return {prior.state.pose(), prior.covariance.topLeftCorner<6, 6>()};
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

// With a DVL, images alone serve after so long without bottom lock.
constexpr Duration kDvlPatience{2'000'000'000};
// How long the DVL may take to show their scale.
constexpr Duration kScaleSearch{10'000'000'000};

fusion::Config scale_to_camera(fusion::Config config, const Rig& rig) {
  if (rig.cameras.empty()) return config;
  fusion::DegeneracyCheckConfig& fine = config.discriminator.degeneracy;
  fine = fusion::scale_to_camera(fine, rig.cameras.front().model.parameters().fx);
  return config;
}

}  // namespace

std::optional<StampedPose> FrameOutput::fused() const {
  if (!fusion.pose) return std::nullopt;
  return StampedPose{stamp, fusion.pose->T_world_body};
}

bool FrameOutput::is_up_to_scale() const {
  return fusion.state == fusion::FusionState::vio_only && vio.has_state() && vio.up_to_scale;
}

std::string_view FrameOutput::pose_source() const {
  return is_up_to_scale() ? "up_to_scale" : fusion::to_string(fusion.state);
}

FusionStage::FusionStage(const vio::Config& vio, const fusion::Config& fusion,
                         const fusion::FreezeConfig& freeze, const Rig& rig,
                         const ActiveSensors& sensors, double segment_gap_s)
    // The baseline without freezing reinitializes like a system without a DVL.
    : tight_(vio.graph == vio::GraphKind::tight && rig.dvl),
      allow_state_prior_(freeze.enabled || tight_),
      track_drift_(fusion.discriminator.agreement.window_s > 0.0),
      unfreeze_(freeze.frozen_frames == fusion::FrozenFrames::unfreeze),
      estimator_(vio, rig),
      fuser_(scale_to_camera(fusion, rig), freeze),
      segment_gap_s_(segment_gap_s),
      with_dvl_(sensors.dvl),
      p_body_camera_(rig.cameras.front().T_body_camera.translation),
      scale_finder_(rig, sensors),
      height_is_measured_(rig.pressure || rig.depth) {
  if (vio.visual.enabled) images_alone_.emplace(vio, rig);
}

FrameOutput FusionStage::process(const FrameJob& job,
                                 const std::optional<vio::TrackedFrame>& tracked) {
  const Stopwatch watch;
  if (!first_frame_) first_frame_ = job.stamp;
  for (const ImuSample& sample : job.imu) add(sample);
  for (const vio::DvlMeasurement& ping : job.pings) {
    scale_finder_.add(ping);
    estimator_.add(ping);
  }
  for (const vio::PressureDepthMeasurement& depth : job.depths) {
    scale_finder_.add(depth);
    estimator_.add(depth);
  }
  for (const dipo::Report& report : job.reports) fuser_.add(report);

  FrameOutput output;
  output.stamp = job.stamp;
  const std::optional<vio::StatePrior> acoustic = acoustic_prior(job);
  const std::optional<vio::StatePrior> dipo = to_output_frame(acoustic);
  if (!tracked) {
    output.dropped = true;
    if (dipo) output.dipo = dipo->state.pose();
    return output;
  }
  output.statistics = tracked->statistics;
  const bool with_prior = allow_state_prior_ || !vio_init_time_s_;
  std::optional<vio::StatePrior> prior;
  if (dipo) prior = vio::transformed(T_vio_dipo_, *dipo);
  output.vio = with_prior && prior
                   ? estimator_.process(*tracked, prior)
                   : estimator_.process(*tracked, std::nullopt, restart_pose(prior));
  const bool by_images = images_alone_ && images_may_serve(job, acoustic.has_value());
  // The DVL's poses of these frames have been output.
  if (with_dvl_ && !by_images) output.vio.earlier.clear();
  if (by_images) use_images_alone(*tracked, output);
  if (output.vio.status == vio::Status::lost) {
    log::warning("VIO lost at {:.2f} s: {}", seconds_between(*first_frame_, job.stamp),
                 output.vio.detail);
  }
  if (output.vio.has_state() && !vio_init_time_s_) {
    vio_init_time_s_ = seconds_between(*first_frame_, job.stamp);
  }
  if (acoustic && std::exchange(align_pending_, false)) {
    const bool initialized_from_dipo = output.vio.status == vio::Status::started && with_prior;
    align_dipo(*acoustic, output.vio, output.vio.has_state() && !initialized_from_dipo);
  }
  fusion::FusionInput input;
  input.stamp = job.stamp;
  input.statistics = output.statistics;
  input.vio_includes_dipo = tight_;
  if (const auto here = to_output_frame(acoustic)) {
    input.dipo = estimate_of(*here);
    output.dipo = input.dipo->T_world_body;
  }
  if (output.vio.has_state()) input.vio = estimate_of(output.vio);
  output.fusion = fuser_.update(input);
  update_vio_dipo_transform(input, output);
  if (output.fusion.pose) add_segment_error(output);
  apply(output.fusion.freeze.action);
  output.timing.solve_s = output.vio.solve_s;
  output.timing.information_s = output.vio.information_s;
  output.timing.marginalize_s = output.vio.marginalize_s;
  output.timing.localize_s = watch.seconds();
  return output;
}

// Without bottom lock at the start, images alone serve first. The DVL then shows their scale, and
// DIPO continues at the last pose.
std::optional<vio::StatePrior> FusionStage::acoustic_prior(const FrameJob& job) {
  if (!job.dipo || !last_pose_ || T_output_dipo_) return job.dipo;
  if (scale_finder_.is_waiting()) {
    if (!dipo_waits_since_) dipo_waits_since_ = job.stamp;
    if (job.stamp - *dipo_waits_since_ < kScaleSearch) return std::nullopt;
    log::warning("poses before {:.2f} s stay up to scale: the DVL does not agree with the images",
                 seconds_between(*first_frame_, job.stamp));
    scale_finder_.give_up();
  }
  if (estimator_.started()) return job.dipo;
  SE3 before = job.dipo->state.pose();
  before.translation -=
      seconds_between(last_pose_stamp_, job.stamp) * (before.rotation * job.dipo->state.v_body);
  T_output_dipo_ = vio::level_alignment(last_pose_->T_world_body, before);
  align_pending_ = false;
  if (images_alone_) images_alone_->reset();
  return job.dipo;
}

bool FusionStage::images_may_serve(const FrameJob& job, bool with_dipo) const {
  if (!with_dvl_) return true;
  if (with_dipo || T_output_dipo_) return false;
  return scale_finder_.is_waiting() || images_alone_->started() ||
         job.stamp - *first_frame_ > kDvlPatience;
}

// Visual-inertial odometry is preferred: it knows the scale.
void FusionStage::use_images_alone(const vio::TrackedFrame& tracked, FrameOutput& output) {
  vio::Result& vio = output.vio;
  if (vio.has_state()) return hand_over(output);
  const auto last = last_pose_ ? std::optional(last_pose_->T_world_body) : std::nullopt;
  vio::Result found = images_alone_->process(tracked, last);
  if (last_imu_) found.detail = vio.detail;  // what keeps the scale unknown
  if (!found.has_state() && last_imu_) return;
  vio = std::move(found);
  const bool was_waiting = scale_finder_.is_waiting();
  output.scale_found = scale_finder_.add(vio);
  if (output.scale_found) return use_scale(*output.scale_found, vio);
  if (was_waiting || !scale_finder_.is_waiting()) return;
  log::info("poses up to scale from {:.2f} s on, by images alone",
            seconds_between(*first_frame_, scale_finder_.since()));
}

// From images alone to visual-inertial odometry.
void FusionStage::hand_over(FrameOutput& output) {
  vio::Result& vio = output.vio;
  const auto scale = scale_finder_.compare(vio);
  if (scale) {
    estimator_.shift(scale->shift);
    vio.state.p_world += scale->shift;
    for (StampedPose& pose : vio.earlier) pose.T_world_body.translation += scale->shift;
    output.scale_found = scale->found;
    log::info("scale found by the IMU at {:.2f} s: the unit so far was {:.3g} m",
              seconds_between(*first_frame_, vio.stamp), scale->found.to_meters.scale);
  } else if (scale_finder_.is_waiting()) {
    log::warning("poses before {:.2f} s stay up to scale: no image relates them to later ones",
                 seconds_between(*first_frame_, vio.stamp));
  }
  scale_finder_.give_up();
  images_alone_->follow(estimator_.window());
}

// The poses so far, this one included, change their unit.
void FusionStage::use_scale(const ScaleFound& found, vio::Result& vio) {
  images_alone_->change_scale(found.to_meters);
  vio.state.p_world = changed(found.to_meters, vio.state.pose(), p_body_camera_).translation;
  for (StampedPose& pose : vio.earlier) {
    pose.T_world_body = changed(found.to_meters, pose.T_world_body, p_body_camera_);
  }
  vio.up_to_scale = false;
  scale_finder_.give_up();
  log::info("scale found by the {} at {:.2f} s: the unit so far was {:.3g} m",
            found.by == ScaleSensor::dvl ? "DVL" : "depth",
            seconds_between(*first_frame_, vio.stamp), found.to_meters.scale);
}

// Nothing relates the poses before a long gap to those after it.
void FusionStage::add(const ImuSample& sample) {
  if (last_imu_ && seconds_between(*last_imu_, sample.stamp) > segment_gap_s_) {
    estimator_.reset();
    fuser_.begin_segment();
    segment_began_ = align_pending_ = true;
  }
  last_imu_ = sample.stamp;
  estimator_.add(sample);
  if (images_alone_) images_alone_->add(sample);
}

// The estimators know the error within the segment only.
void FusionStage::add_segment_error(FrameOutput& output) {
  fusion::PoseEstimate& pose = *output.fusion.pose;
  output.begins_segment = std::exchange(segment_began_, false) && last_pose_;
  if (output.begins_segment) {
    const bool height = !(T_output_dipo_ && height_is_measured_);
    segment_error_ = {last_pose_->T_world_body, last_pose_->covariance,
                      seconds_between(last_pose_stamp_, output.stamp), height};
  }
  output.segment_covariance = segment_error_.covariance(pose.T_world_body);
  pose.covariance += output.segment_covariance;
  last_pose_ = pose;
  last_pose_stamp_ = output.stamp;
}

std::optional<vio::StatePrior> FusionStage::to_output_frame(
    const std::optional<vio::StatePrior>& dipo) const {
  if (!dipo || !T_output_dipo_) return dipo;
  return vio::transformed(*T_output_dipo_, *dipo);
}

void FusionStage::align_dipo(const vio::StatePrior& dipo, const vio::Result& vio,
                             bool vio_was_first) {
  if (!T_output_dipo_) T_output_dipo_ = SE3::identity();
  if (!vio_was_first) return;
  T_vio_dipo_ = SE3::identity();
  T_output_dipo_ = vio::level_alignment(vio.state.pose(), dipo.state.pose());
}

// Pose at which VIO continues when it initializes without a prior.
std::optional<SE3> FusionStage::restart_pose(const std::optional<vio::StatePrior>& dipo) const {
  if (dipo) return dipo->state.pose();
  return last_pose_ ? std::optional(last_pose_->T_world_body) : std::nullopt;
}

// When DIPO bridges an outage or reinitializes VIO, the drift between the two since the start must
// not shift the window: it continues at VIO's own last pose.
void FusionStage::update_vio_dipo_transform(const fusion::FusionInput& input,
                                            const FrameOutput& output) {
  if (!track_drift_ || output.fusion.state != fusion::FusionState::fused) return;
  T_vio_dipo_ = vio::level_alignment(input.vio->T_world_body, input.dipo->T_world_body);
}

void FusionStage::apply(fusion::Action action) {
  switch (action) {
    case fusion::Action::none:
      return;
    case fusion::Action::freeze:
      return estimator_.freeze();
    case fusion::Action::release:
      return unfreeze_ ? estimator_.unfreeze() : estimator_.release();
    case fusion::Action::reset:
      return estimator_.reset();
  }
}

}  // namespace apvi::localization
