// SPDX-License-Identifier: BSD-3-Clause
#include "localization/synchronizer.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "apvi/core/log.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi::localization {
namespace {

constexpr Duration kBufferDuration{5'000'000'000};

// Largest stamp difference within a stereo pair.
constexpr Duration kStereoTolerance{5'000'000};
// How long the first image of a pair waits for the second.
constexpr Duration kStereoTimeout{30'000'000};

// A camera outage begins when no image has arrived for this long and for three image periods.
constexpr Duration kCameraTimeout{500'000'000};
// Until the first image: cameras that are started with the other sensors report within this time.
constexpr Duration kFirstImageTimeout{2'000'000'000};
// Period of jobs without images during a camera outage.
constexpr Duration kImagelessJobPeriod{100'000'000};

// Without a DVL there are no frames while the camera is silent, and nobody takes the samples. VIO
// starts anew after so long an outage.
constexpr Duration kMaxPending{60'000'000'000};

// Segments that are logged.
constexpr int kMaxMessages = 20;

// Frames waiting for IMU data; beyond this the oldest is dropped.
constexpr std::size_t kMaxPendingJobs = 60;

Stamp to_imu_clock(const ImageFrame& image, const Rig& rig) {
  const auto camera = static_cast<std::size_t>(image.camera);
  return image.stamp - Duration::from_seconds(rig.cameras.at(camera).time_offset_s);
}

// A ping with the filter's calibration applied: on the IMU clock, scaled; the uncertainty of its
// time offset adds noise along the acceleration.
vio::DvlMeasurement to_vio_measurement(const DvlSample& ping, const dipo::Estimate& estimate,
                                       const Rig& rig, const Eigen::Vector3d& acceleration) {
  const dipo::State& s = estimate.state;
  const Eigen::Matrix3d R_dvl_body = s.R_body_dvl.conjugate().toRotationMatrix();
  const Eigen::Vector3d a = R_dvl_body * acceleration;
  const double noise = rig.dvl->velocity_noise;
  const double time_variance = estimate.covariance(dipo::kTimeOffset, dipo::kTimeOffset);
  // The graph uses the rig's mounting; the correction estimated by the filter is applied here.
  const Eigen::Quaterniond R_rig_estimated =
      rig.dvl->T_body_dvl.rotation.conjugate() * s.R_body_dvl;
  return {.stamp = ping.stamp - Duration::from_seconds(s.dvl_time_offset_s),
          .velocity =
              R_rig_estimated * (rig.dvl->true_velocity(ping.velocity) / (1.0 + s.dvl_scale_error)),
          .covariance =
              noise * noise * Eigen::Matrix3d::Identity() + time_variance * a * a.transpose()};
}

// A ping as the rig describes it.
vio::DvlMeasurement uncorrected(const DvlSample& ping, const Rig& rig) {
  const double noise = rig.dvl->velocity_noise;
  return {.stamp = ping.stamp - Duration::from_seconds(rig.dvl->time_offset_s),
          .velocity = rig.dvl->true_velocity(ping.velocity),
          .covariance = noise * noise * Eigen::Matrix3d::Identity()};
}

// Beam end points; beam vectors point from the transducer outward.
RangePoints to_range_points(const DvlSample& ping, const dipo::Estimate& estimate, const Rig& rig) {
  RangePoints result{.stamp = ping.stamp - Duration::from_seconds(estimate.state.dvl_time_offset_s),
                     .points = {}};
  for (std::size_t i = 0; i < kDvlBeams; ++i) {
    const std::optional<DvlBeam>& beam = ping.beams[i];
    if (!beam || !beam->valid || !beam->range || *beam->range <= 0.0) continue;
    result.points.push_back(rig.dvl->T_body_dvl *
                            (rig.dvl->scale * *beam->range * rig.dvl->beams[i]));
  }
  return result;
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

Synchronizer::Synchronizer(const dipo::Config& config, const Rig& rig, const ActiveSensors& sensors)
    : rig_(rig),
      gravity_(config.gravity),
      segment_gap_s_(config.inertial.segment_gap_s),
      imu_in_use_(sensors.imu),
      dvl_scale_(sensors.dvl_scale),
      cameras_(sensors.cameras),
      imu_(kBufferDuration) {
  if (sensors.dvl) acoustic_odometry_.emplace(config, rig);
}

Synchronizer::Output Synchronizer::process(const SensorEvent& event) {
  Output output;
  if (const auto* image = std::get_if<ImageFrame>(&event)) {
    if (cameras_ > 0) add(*image);
  } else {
    add(event);
    if (acoustic_odometry_ && std::holds_alternative<ImuSample>(event))
      add_imageless_job(stamp_of(event));
    if (acoustic_odometry_) output.pings = acoustic_odometry_->process(event);
    add_pings(output.pings);
  }
  const Stamp now = stamp_of(event);
  while (!pending_jobs_.empty() && is_ready(pending_jobs_.front(), now)) {
    complete(pending_jobs_.front());
    output.frames.push_back(std::move(pending_jobs_.front()));
    pending_jobs_.pop_front();
  }
  return output;
}

void Synchronizer::add(const ImageFrame& image) {
  if (static_cast<std::size_t>(image.camera) >= cameras_) return;
  const Stamp stamp = to_imu_clock(image, rig_);
  for (FrameJob& job : pending_jobs_) {
    if (std::abs((job.stamp - stamp).ns) > kStereoTolerance.ns) continue;
    job.images[static_cast<std::size_t>(image.camera)] = image;
    return;
  }
  if (image.camera != 0) return;  // the first image of the pair was lost
  update_image_period(stamp);
  FrameJob job;
  job.stamp = stamp;
  job.images.resize(cameras_);
  job.images[0] = image;
  pending_jobs_.push_back(std::move(job));
  if (pending_jobs_.size() <= kMaxPendingJobs) return;
  if (abandoned_frames_++ == 0) log::warning("camera: dropping frames: no IMU data");
  pending_jobs_.pop_front();
}

void Synchronizer::update_image_period(Stamp stamp) {
  if (last_image_) image_period_ = stamp - *last_image_;
  last_image_ = stamp;
  any_image_ = true;
}

void Synchronizer::add_imageless_job(Stamp now) {
  if (cameras_ == 0) return;
  const Stamp since = last_image_.value_or(*first_imu_);
  const Duration patience{std::max(kCameraTimeout.ns, 3 * image_period_.ns)};
  if (now - since < (any_image_ ? patience : kFirstImageTimeout)) return;
  const Stamp last =
      pending_jobs_.empty() ? last_frame_.value_or(since) : pending_jobs_.back().stamp;
  if (now - last < kImagelessJobPeriod) return;
  FrameJob job;
  job.stamp = now;
  job.images.resize(cameras_);
  pending_jobs_.push_back(std::move(job));
}

void Synchronizer::add(const SensorEvent& event) {
  if (const auto* sample = std::get_if<ImuSample>(&event)) {
    add(*sample);
  } else if (const auto* ping = std::get_if<DvlSample>(&event)) {
    pings_[ping->stamp] = *ping;
    constexpr std::size_t kMaxPings = 64;
    while (pings_.size() > kMaxPings) pings_.erase(pings_.begin());
    if (dvl_scale_ && ping->valid) new_pings_.push_back(uncorrected(*ping, rig_));
  }
  if (cameras_ == 0) return;
  if (const auto* p = std::get_if<PressureSample>(&event); p && rig_.pressure) {
    new_depths_.push_back({p->stamp, rig_.pressure->depth(p->pressure_pa),
                           std::hypot(rig_.pressure->noise_m, swell_m())});
  } else if (const auto* d = std::get_if<PressureDepthSample>(&event); d && rig_.depth) {
    new_depths_.push_back({d->stamp, d->depth_m, std::hypot(rig_.depth->noise_m, swell_m())});
  }
}

void Synchronizer::add(const ImuSample& sample) {
  if (!first_imu_) first_imu_ = run_began_ = sample.stamp;
  const auto last = imu_.newest();
  if (last && seconds_between(*last, sample.stamp) > segment_gap_s_) {
    begin_segment(*last, sample.stamp);
  }
  if (!imu_.add(sample) || cameras_ == 0) return;
  new_imu_.push_back(sample);
  if (sample.stamp - new_imu_.front().stamp < kMaxPending) return;
  new_imu_.clear();
  new_depths_.clear();
}

// Frames in the gap have no motion that relates them to others.
void Synchronizer::begin_segment(Stamp last, Stamp now) {
  if (++segments_ <= kMaxMessages) {
    log::info("a new segment begins at {:.2f} s, after {:.2f} s without inertial samples",
              seconds_between(*run_began_, now), seconds_between(last, now));
  }
  const auto in_gap = [now](const FrameJob& job) { return job.stamp < now; };
  abandoned_frames_ += std::erase_if(pending_jobs_, in_gap);
  imu_ = imu::SampleBuffer(kBufferDuration);
  last_frame_.reset();
  last_image_.reset();
  first_imu_ = now;
}

double Synchronizer::swell_m() const {
  return acoustic_odometry_ ? acoustic_odometry_->dipo().swell_m() : 0.0;
}

void Synchronizer::add_pings(const std::vector<PingOutput>& outputs) {
  if (cameras_ == 0) return;
  for (const PingOutput& output : outputs) {
    new_reports_.push_back(output.ping);
    const dipo::Verdict verdict = output.ping.verdict;
    if (verdict != dipo::Verdict::accepted && verdict != dipo::Verdict::downweighted) continue;
    const auto raw = pings_.find(output.ping.stamp);
    if (raw == pings_.end() || !raw->second.valid) continue;
    const imu::NavState& nav = output.estimate.state.nav;
    Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();
    if (const auto sample = imu_.at(output.estimate.stamp)) {
      acceleration = sample->accel - nav.accel_bias +
                     nav.R_world_body.conjugate() * rig_.gravity(gravity_) -
                     (sample->gyro - nav.gyro_bias).cross(nav.v_body);
    }
    new_pings_.push_back(to_vio_measurement(raw->second, output.estimate, rig_, acceleration));
    new_range_points_.push_back(to_range_points(raw->second, output.estimate, rig_));
  }
}

bool Synchronizer::is_ready(const FrameJob& job, Stamp now) const {
  const auto newest = imu_.newest();
  if (imu_in_use_ && (!newest || *newest < job.stamp)) return false;
  const bool complete = std::all_of(job.images.begin(), job.images.end(),
                                    [](const ImageFrame& image) { return bool(image.decode); });
  return complete || now >= job.stamp + kStereoTimeout;
}

void Synchronizer::complete(FrameJob& job) {
  job.imu = std::exchange(new_imu_, {});
  job.pings = std::exchange(new_pings_, {});
  job.range_points = std::exchange(new_range_points_, {});
  job.depths = std::exchange(new_depths_, {});
  job.reports = std::exchange(new_reports_, {});
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();
  if (acoustic_odometry_) {
    if (const auto estimate = acoustic_odometry_->dipo().at(job.stamp)) {
      job.dipo = vio::StatePrior{
          estimate->state.nav, estimate->covariance.topLeftCorner<imu::kNavSize, imu::kNavSize>()};
      gyro_bias = estimate->state.nav.gyro_bias;
    }
  }
  if (last_frame_) {
    const auto samples = imu_.between(*last_frame_, job.stamp);
    if (!samples.empty()) job.R_before_now = integrate_gyro(samples, gyro_bias);
  }
  last_frame_ = job.stamp;
}

}  // namespace apvi::localization
