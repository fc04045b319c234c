// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/navigator.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "apvi/core/log.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi::pipeline {
namespace {

constexpr Duration kKeepSamples{5'000'000'000};

// Images of two cameras that belong together.
constexpr Duration kSameFrame{5'000'000};
// How long the first waits for the second.
constexpr Duration kStereoPatience{30'000'000};

// Cameras are silent when nothing comes for so long, and for three times as long as between the
// last two images.
constexpr Duration kSilence{500'000'000};
// Of the jobs that bridge a silence.
constexpr Duration kSilentPeriod{100'000'000};

// Frames that may wait for inertial data before the oldest is given up.
constexpr std::size_t kMostWaiting = 60;

Stamp true_stamp(const ImageFrame& image, const Rig& rig) {
  const auto camera = static_cast<std::size_t>(image.camera);
  return image.stamp - Duration::from_seconds(rig.cameras.at(camera).time_offset_s);
}

// A ping as the filter sees it now: on the true clock, scaled, with what it does not know of its
// time as noise along the acceleration.
vio::DvlMeasurement corrected(const DvlSample& ping, const dipo::Estimate& estimate, const Rig& rig,
                              const Eigen::Vector3d& acceleration) {
  const dipo::State& s = estimate.state;
  const Eigen::Matrix3d R_dvl_body = s.R_body_dvl.conjugate().toRotationMatrix();
  const Eigen::Vector3d a = R_dvl_body * acceleration;
  const double noise = rig.dvl->velocity_noise;
  const double time_variance = estimate.covariance(dipo::kTimeOffset, dipo::kTimeOffset);
  // The graph knows the mounting of the rig; what the filter has learnt is taken out here.
  const Eigen::Quaterniond R_rig_learnt = rig.dvl->T_body_dvl.rotation.conjugate() * s.R_body_dvl;
  return {.stamp = ping.stamp - Duration::from_seconds(s.dvl_time_offset_s),
          .velocity =
              R_rig_learnt * (rig.dvl->true_velocity(ping.velocity) / (1.0 + s.dvl_scale_error)),
          .covariance =
              noise * noise * Eigen::Matrix3d::Identity() + time_variance * a * a.transpose()};
}

// Beams look where their vectors point.
RangedPing ranged(const DvlSample& ping, const dipo::Estimate& estimate, const Rig& rig) {
  RangedPing seen{.stamp = ping.stamp - Duration::from_seconds(estimate.state.dvl_time_offset_s),
                  .points = {}};
  for (std::size_t i = 0; i < kDvlBeams; ++i) {
    const std::optional<DvlBeam>& beam = ping.beams[i];
    if (!beam || !beam->valid || !beam->range || *beam->range <= 0.0) continue;
    seen.points.push_back(rig.dvl->T_body_dvl *
                          (rig.dvl->scale * *beam->range * rig.dvl->beams[i]));
  }
  return seen;
}

Eigen::Quaterniond integrate_gyro(const std::vector<ImuSample>& samples,
                                  const Eigen::Vector3d& bias) {
  Eigen::Quaterniond R = Eigen::Quaterniond::Identity();
  for (std::size_t k = 1; k < samples.size(); ++k) {
    const double dt = seconds_between(samples[k - 1].stamp, samples[k].stamp);
    const Eigen::Vector3d rate = 0.5 * (samples[k - 1].gyro + samples[k].gyro) - bias;
    R = R * so3::exp(rate * dt);
  }
  return R.normalized();
}

}  // namespace

Navigator::Navigator(const dipo::Config& config, const Rig& rig, bool use_dvl, std::size_t cameras)
    : rig_(rig), cameras_(cameras), imu_(kKeepSamples) {
  if (use_dvl) localization_.emplace(config, rig);
}

Navigator::Output Navigator::process(const SensorEvent& event) {
  Output output;
  if (const auto* image = std::get_if<ImageFrame>(&event)) {
    if (cameras_ > 0) take(*image);
  } else {
    take(event);
    if (localization_ && std::holds_alternative<ImuSample>(event)) bridge_silence(stamp_of(event));
    if (localization_) output.pings = localization_->process(event);
    note_pings(output.pings);
  }
  const Stamp now = stamp_of(event);
  while (!waiting_.empty() && is_ready(waiting_.front(), now)) {
    complete(waiting_.front());
    output.frames.push_back(std::move(waiting_.front()));
    waiting_.pop_front();
  }
  return output;
}

void Navigator::take(const ImageFrame& image) {
  if (static_cast<std::size_t>(image.camera) >= cameras_) return;
  const Stamp stamp = true_stamp(image, rig_);
  for (FrameJob& job : waiting_) {
    if (std::abs((job.stamp - stamp).ns) > kSameFrame.ns) continue;
    job.images[static_cast<std::size_t>(image.camera)] = image;
    return;
  }
  if (image.camera != 0) return;  // its partner was lost
  note_image(stamp);
  FrameJob job;
  job.stamp = stamp;
  job.images.resize(cameras_);
  job.images[0] = image;
  waiting_.push_back(std::move(job));
  if (waiting_.size() <= kMostWaiting) return;
  if (abandoned_frames_++ == 0) log::warning("camera: frames are given up: no inertial data");
  waiting_.pop_front();
}

void Navigator::note_image(Stamp stamp) {
  if (last_image_) image_period_ = stamp - *last_image_;
  last_image_ = stamp;
}

void Navigator::bridge_silence(Stamp now) {
  if (cameras_ == 0) return;
  if (!first_imu_) first_imu_ = now;
  const Stamp since = last_image_.value_or(*first_imu_);
  if (now - since < Duration{std::max(kSilence.ns, 3 * image_period_.ns)}) return;
  const Stamp last = waiting_.empty() ? last_frame_.value_or(since) : waiting_.back().stamp;
  if (now - last < kSilentPeriod) return;
  FrameJob job;
  job.stamp = now;
  job.images.resize(cameras_);
  waiting_.push_back(std::move(job));
}

void Navigator::take(const SensorEvent& event) {
  if (const auto* sample = std::get_if<ImuSample>(&event)) {
    if (imu_.add(*sample)) fresh_imu_.push_back(*sample);
  } else if (const auto* ping = std::get_if<DvlSample>(&event)) {
    raw_pings_[ping->stamp] = *ping;
    constexpr std::size_t kMostPings = 64;
    while (raw_pings_.size() > kMostPings) raw_pings_.erase(raw_pings_.begin());
  }
  if (const auto* p = std::get_if<PressureSample>(&event); p && rig_.pressure) {
    fresh_depths_.push_back({p->stamp, rig_.pressure->depth(p->pressure_pa),
                             std::hypot(rig_.pressure->noise_m, swell_m())});
  } else if (const auto* d = std::get_if<DepthSample>(&event); d && rig_.depth) {
    fresh_depths_.push_back({d->stamp, d->depth_m, std::hypot(rig_.depth->noise_m, swell_m())});
  }
}

double Navigator::swell_m() const {
  return localization_ ? localization_->dipo().swell_m() : 0.0;
}

void Navigator::note_pings(const std::vector<LocalizationOutput>& outputs) {
  for (const LocalizationOutput& output : outputs) {
    fresh_reports_.push_back(output.ping);
    const dipo::Verdict verdict = output.ping.verdict;
    if (verdict != dipo::Verdict::accepted && verdict != dipo::Verdict::weakened) continue;
    const auto raw = raw_pings_.find(output.ping.stamp);
    if (raw == raw_pings_.end() || !raw->second.valid) continue;
    const imu::NavState& nav = output.estimate.state.nav;
    Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();
    if (const auto sample = imu_.at(output.estimate.stamp)) {
      acceleration = sample->accel - nav.accel_bias +
                     nav.R_world_body.conjugate() * rig_.gravity(9.81) -
                     (sample->gyro - nav.gyro_bias).cross(nav.v_body);
    }
    fresh_pings_.push_back(corrected(raw->second, output.estimate, rig_, acceleration));
    fresh_ranges_.push_back(ranged(raw->second, output.estimate, rig_));
  }
}

bool Navigator::is_ready(const FrameJob& job, Stamp now) const {
  const auto newest = imu_.newest();
  if (!newest || *newest < job.stamp) return false;
  const bool complete = std::all_of(job.images.begin(), job.images.end(),
                                    [](const ImageFrame& image) { return bool(image.decode); });
  return complete || now >= job.stamp + kStereoPatience;
}

void Navigator::complete(FrameJob& job) {
  job.imu = std::exchange(fresh_imu_, {});
  job.pings = std::exchange(fresh_pings_, {});
  job.ranges = std::exchange(fresh_ranges_, {});
  job.depths = std::exchange(fresh_depths_, {});
  job.reports = std::exchange(fresh_reports_, {});
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();
  if (localization_) {
    if (const auto estimate = localization_->dipo().at(job.stamp)) {
      job.dipo = vio::Aid{estimate->state.nav,
                          estimate->covariance.topLeftCorner<imu::kNavSize, imu::kNavSize>()};
      gyro_bias = estimate->state.nav.gyro_bias;
    }
  }
  if (last_frame_) {
    const auto samples = imu_.between(*last_frame_, job.stamp);
    if (!samples.empty()) job.R_before_now = integrate_gyro(samples, gyro_bias);
  }
  last_frame_ = job.stamp;
}

}  // namespace apvi::pipeline
