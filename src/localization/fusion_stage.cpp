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

// Frames of which the poses by images alone are kept: more than VIO needs to initialize.
constexpr Duration kStartHistory{10'000'000'000};

double spread(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) mean += p / static_cast<double>(points.size());
  double sum = 0.0;
  for (const Eigen::Vector3d& p : points) sum += (p - mean).squaredNorm();
  return std::sqrt(sum);
}

// Ratio of the spreads of the camera's positions at equal stamps; nullopt with fewer than three of
// them, or at rest.
std::optional<double> scale_between(const std::deque<StampedPose>& up_to_scale,
                                    const std::vector<StampedPose>& metric,
                                    const Eigen::Vector3d& p_body_camera) {
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  for (const StampedPose& pose : metric) {
    const auto same = [&](const StampedPose& p) { return p.stamp == pose.stamp; };
    const auto found = std::ranges::find_if(up_to_scale, same);
    if (found == up_to_scale.end()) continue;
    from.push_back(found->T_world_body * p_body_camera);
    to.push_back(pose.T_world_body * p_body_camera);
  }
  if (from.size() < 3) return std::nullopt;
  const double up_to_scale_spread = spread(from);
  if (!(up_to_scale_spread > 0.0)) return std::nullopt;
  return spread(to) / up_to_scale_spread;
}

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
      height_is_measured_(rig.pressure || rig.depth) {
  if (!sensors.dvl && vio.visual.enabled) images_alone_.emplace(vio, rig);
  if (sensors.dvl_scale) dvl_scale_.emplace(*rig.dvl, p_body_camera_);
}

FrameOutput FusionStage::process(const FrameJob& job,
                                 const std::optional<vio::TrackedFrame>& tracked) {
  const Stopwatch watch;
  if (!first_frame_) first_frame_ = job.stamp;
  for (const ImuSample& sample : job.imu) add(sample);
  for (const vio::DvlMeasurement& ping : job.pings) {
    dvl_scale_ ? dvl_scale_->add(ping) : estimator_.add(ping);
  }
  for (const vio::PressureDepthMeasurement& depth : job.depths) estimator_.add(depth);
  for (const dipo::Report& report : job.reports) fuser_.add(report);

  FrameOutput output;
  output.stamp = job.stamp;
  const std::optional<vio::StatePrior> dipo = to_output_frame(job.dipo);
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
  if (with_dvl_) output.vio.earlier.clear();  // the DVL's poses of these frames have been output
  if (images_alone_) use_images_alone(*tracked, output);
  if (output.vio.status == vio::Status::lost) {
    log::warning("VIO lost at {:.2f} s: {}", seconds_between(*first_frame_, job.stamp),
                 output.vio.detail);
  }
  if (output.vio.has_state() && !vio_init_time_s_) {
    vio_init_time_s_ = seconds_between(*first_frame_, job.stamp);
  }
  if (job.dipo && std::exchange(align_pending_, false)) {
    const bool initialized_from_dipo = output.vio.status == vio::Status::started && with_prior;
    align_dipo(*job.dipo, output.vio, output.vio.has_state() && !initialized_from_dipo);
  }
  fusion::FusionInput input;
  input.stamp = job.stamp;
  input.statistics = output.statistics;
  input.vio_includes_dipo = tight_;
  if (const auto here = to_output_frame(job.dipo)) {
    input.dipo = estimate_of(*here);
    output.dipo = input.dipo->T_world_body;
  }
  if (output.vio.has_state()) input.vio = estimate_of(output.vio);
  output.fusion = fuser_.update(input);
  update_vio_dipo_transform(input, output);
  if (output.fusion.pose) add_segment_error(*output.fusion.pose, job.stamp);
  apply(output.fusion.freeze.action);
  output.timing.solve_s = output.vio.solve_s;
  output.timing.information_s = output.vio.information_s;
  output.timing.marginalize_s = output.vio.marginalize_s;
  output.timing.localize_s = watch.seconds();
  return output;
}

// Visual-inertial odometry is preferred: it knows the scale.
void FusionStage::use_images_alone(const vio::TrackedFrame& tracked, FrameOutput& output) {
  vio::Result& vio = output.vio;
  if (vio.has_state()) {
    output.scale_found = find_scale(vio);
    if (first_up_to_scale_ && !output.scale_found) {
      log::warning("poses before {:.2f} s stay up to scale: no image relates them to later ones",
                   seconds_between(*first_frame_, vio.stamp));
    }
    first_up_to_scale_.reset();
    return images_alone_->reset();
  }
  const auto last = last_pose_ ? std::optional(last_pose_->T_world_body) : std::nullopt;
  vio::Result found = images_alone_->process(tracked, last);
  if (last_imu_) found.detail = vio.detail;  // what keeps the scale unknown
  if (!found.has_state() && last_imu_) return;
  vio = std::move(found);
  if (dvl_scale_) output.scale_found = find_scale_by_dvl(vio);
  if (!vio.up_to_scale) return;
  if (!vio_init_time_s_ || first_up_to_scale_) remember_up_to_scale(vio);
}

void FusionStage::remember_up_to_scale(const vio::Result& vio) {
  if (!vio.has_state()) return;
  for (const StampedPose& earlier : vio.earlier) recent_up_to_scale_.push_back(earlier);
  recent_up_to_scale_.push_back({vio.stamp, vio.state.pose()});
  if (!first_up_to_scale_) first_up_to_scale_ = recent_up_to_scale_.front();
  const Stamp oldest = vio.stamp - kStartHistory;
  while (recent_up_to_scale_.front().stamp < oldest) recent_up_to_scale_.pop_front();
}

// Compares the frames that both know. The first pose stays where it is; the poses of
// visual-inertial odometry move accordingly.
std::optional<ScaleFound> FusionStage::find_scale(vio::Result& vio) {
  if (!first_up_to_scale_ || vio.earlier.empty()) return std::nullopt;
  const auto scale = scale_between(recent_up_to_scale_, vio.earlier, p_body_camera_);
  if (!scale) return std::nullopt;
  ScaleFound found = scale_found(*scale);
  const StampedPose& newest = vio.earlier.back();
  const auto known = std::ranges::find(recent_up_to_scale_, newest.stamp, &StampedPose::stamp);
  if (known == recent_up_to_scale_.end()) return std::nullopt;
  const Eigen::Vector3d shift = found.to_meters * (known->T_world_body * p_body_camera_) -
                                newest.T_world_body * p_body_camera_;
  estimator_.shift(shift);
  vio.state.p_world += shift;
  for (StampedPose& pose : vio.earlier) pose.T_world_body.translation += shift;
  log::info("scale found at {:.2f} s: the unit so far was {:.3g} m",
            seconds_between(*first_frame_, vio.stamp), *scale);
  return found;
}

ScaleFound FusionStage::scale_found(double scale) const {
  return {first_up_to_scale_->stamp,
          {scale, first_up_to_scale_->T_world_body * p_body_camera_},
          p_body_camera_};
}

// The poses so far, this one included, change their unit.
std::optional<ScaleFound> FusionStage::find_scale_by_dvl(vio::Result& found) {
  if (!found.has_state() || !found.up_to_scale) return std::nullopt;
  if (found.status == vio::Status::started) dvl_scale_->reset();
  const auto scale = dvl_scale_->add({found.stamp, found.state.pose()});
  if (!scale || !first_up_to_scale_) return std::nullopt;
  ScaleFound result = scale_found(*scale);
  images_alone_->change_scale(result.to_meters);
  found.state.p_world = changed(result.to_meters, found.state.pose(), p_body_camera_).translation;
  found.up_to_scale = false;
  first_up_to_scale_.reset();
  log::info("scale found by the DVL at {:.2f} s: the unit so far was {:.3g} m",
            seconds_between(*first_frame_, found.stamp), *scale);
  return result;
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
void FusionStage::add_segment_error(fusion::PoseEstimate& pose, Stamp stamp) {
  if (std::exchange(segment_began_, false) && last_pose_) {
    const bool height = !(T_output_dipo_ && height_is_measured_);
    segment_error_ = {last_pose_->T_world_body, last_pose_->covariance,
                      seconds_between(last_pose_stamp_, stamp), height};
  }
  pose.covariance += segment_error_.covariance(pose.T_world_body);
  last_pose_ = pose;
  last_pose_stamp_ = stamp;
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
