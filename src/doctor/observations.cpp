// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/observations.hpp"

#include <algorithm>
#include <cmath>
#include <exception>

namespace apvi::doctor {
namespace {

// The fits use this much of a recording, from the first DVL ping with motion (or the beginning).
constexpr double kWindow = 600.0;      // [s]
constexpr double kBeforeWindow = 5.0;  // [s]
// Limits memory for implausibly high sample rates.
constexpr std::size_t kMaxBuffered = 1'500'000;
constexpr double kMovingSpeed = 0.02;      // [m/s]
constexpr double kMaxVerticalSpeed = 5.0;  // [m/s]
constexpr double kAboveSurface = -0.5;     // [m]

template <typename T>
void drop_before(std::vector<T>& buffer, Stamp stamp) {
  buffer.erase(buffer.begin(), std::find_if(buffer.begin(), buffer.end(), [stamp](const T& sample) {
                 return sample.stamp >= stamp;
               }));
}

bool same_beams(const DvlSample& a, const DvlSample& b) {
  for (std::size_t i = 0; i < kDvlBeams; ++i) {
    if (a.beams[i].has_value() != b.beams[i].has_value()) return false;
    if (a.beams[i] && a.beams[i]->velocity != b.beams[i]->velocity) return false;
  }
  return true;
}

bool same(const DvlSample& a, const DvlSample& b) {
  return a.valid == b.valid && a.velocity == b.velocity && a.altitude == b.altitude &&
         same_beams(a, b);
}

}  // namespace

void Timing::add(Stamp stamp, bool repeats) {
  if (count == 0) first = stamp;
  if (count > 0) {
    const double step = seconds_between(last, stamp);
    steps.add(step);
    if (step > longest_step) {
      longest_step = step;
      longest_at = last;
    }
  }
  last = stamp;
  ++count;
  if (repeats) ++repeated;
}

void BeamMoments::add(const DvlSample& sample) {
  Eigen::Vector4d b;
  for (std::size_t i = 0; i < kDvlBeams; ++i) {
    if (!sample.beams[i] || !sample.beams[i]->valid) return;
    b(static_cast<Eigen::Index>(i)) = sample.beams[i]->velocity;
  }
  ++count;
  beam_beam += b * b.transpose();
  velocity_beam += sample.velocity * b.transpose();
  velocity_velocity += sample.velocity * sample.velocity.transpose();
}

void Collector::add(const SensorEvent& event) {
  if (const auto* imu = std::get_if<ImuSample>(&event)) add_imu(*imu);
  if (const auto* dvl = std::get_if<DvlSample>(&event)) add_dvl(*dvl);
  if (const auto* p = std::get_if<PressureSample>(&event)) {
    const PressureCalibration calibration = rig_.pressure.value_or(PressureCalibration{});
    add_depth(observed_.pressure, p->stamp, p->pressure_pa, calibration.depth(p->pressure_pa));
  }
  if (const auto* d = std::get_if<PressureDepthSample>(&event)) {
    add_depth(observed_.depth, d->stamp, std::abs(d->depth_m), d->depth_m);
  }
  if (const auto* image = std::get_if<ImageFrame>(&event)) add_image(*image);
  if (const auto* gnss = std::get_if<GnssSample>(&event)) observed_.gnss.add(gnss->stamp, false);
}

bool Collector::in_window(Stamp stamp) {
  if (!window_end_) window_end_ = stamp + Duration::from_seconds(kWindow);
  return stamp < *window_end_;
}

void Collector::start_window(Stamp stamp) {
  window_fixed_ = true;
  const Stamp from = stamp - Duration::from_seconds(kBeforeWindow);
  drop_before(observed_.imu.buffer, from);
  drop_before(observed_.pressure.buffer, from);
  drop_before(observed_.depth.buffer, from);
  window_end_ = stamp + Duration::from_seconds(kWindow);
}

void Collector::add_imu(const ImuSample& sample) {
  ImuObservations& observed = observed_.imu;
  const bool repeats =
      last_imu_ && last_imu_->gyro == sample.gyro && last_imu_->accel == sample.accel;
  observed.timing.add(sample.stamp, repeats);
  observed.accel_norm.add(sample.accel.norm());
  observed.gyro_norm.add(sample.gyro.norm());
  observed.accel_sum += sample.accel;
  last_imu_ = sample;
  if (in_window(sample.stamp) && observed.buffer.size() < kMaxBuffered)
    observed.buffer.push_back(sample);
}

void Collector::add_dvl(const DvlSample& sample) {
  DvlObservations& observed = observed_.dvl;
  const bool repeats = last_dvl_ && same(*last_dvl_, sample);
  const bool same_velocity = last_dvl_ && last_dvl_->velocity == sample.velocity;
  observed.timing.add(sample.stamp, repeats);
  last_dvl_ = sample;
  if (sample.figure_of_merit) observed.figure_of_merit.add(*sample.figure_of_merit);
  if (!sample.valid) {
    const double speed = sample.velocity.norm();
    if (speed > kMaxVehicleSpeed && !same_velocity) observed.excessive_speed.add(speed);
    return;
  }
  ++observed.valid;
  const Stamp since = observed.last_valid.value_or(observed.timing.first);
  if (seconds_between(since, sample.stamp) > observed.longest_dropout) {
    observed.longest_dropout = seconds_between(since, sample.stamp);
    observed.dropout_at = since;
  }
  observed.last_valid = sample.stamp;
  observed.speed.add(sample.velocity.norm());
  if (sample.velocity.isZero(0.0)) ++observed.zero;
  const auto beams = std::count_if(sample.beams.begin(), sample.beams.end(),
                                   [](const auto& beam) { return beam.has_value(); });
  const auto valid = std::count_if(sample.beams.begin(), sample.beams.end(),
                                   [](const auto& beam) { return beam && beam->valid; });
  if (beams > 0) ++observed.with_beams;
  if (valid == static_cast<int>(kDvlBeams)) ++observed.four_beams;
  if (repeats) return;
  observed.beams.add(sample);
  if (!window_fixed_ && sample.velocity.norm() > kMovingSpeed) start_window(sample.stamp);
  if (window_fixed_ && in_window(sample.stamp) && observed.buffer.size() < kMaxBuffered) {
    observed.buffer.push_back({sample.stamp, sample.velocity});
  }
}

void Collector::add_depth(DepthObservations& observed, Stamp stamp, double value, double depth) {
  const auto last = last_depth_.find(&observed);
  const bool first = last == last_depth_.end();
  const double step = first ? 0.0 : std::abs(depth - last->second.depth);
  observed.timing.add(stamp, !first && step == 0.0);
  observed.value.add(value);
  if (step > 0.0) observed.depth_step.add(step);
  // Tolerates 0.1 m for sensors with coarse resolution and high rate.
  if (!first && step > 0.1 + kMaxVerticalSpeed * seconds_between(last->second.stamp, stamp))
    ++observed.spikes;
  if (depth < kAboveSurface) ++observed.negative;
  observed.lowest = first ? depth : std::min(observed.lowest, depth);
  observed.highest = first ? depth : std::max(observed.highest, depth);
  last_depth_[&observed] = {stamp, depth};
  if (in_window(stamp) && observed.buffer.size() < kMaxBuffered)
    observed.buffer.push_back({stamp, depth});
}

void Collector::add_image(const ImageFrame& frame) {
  if (frame.camera < 0 || frame.camera > 1) return;
  CameraObservations& observed = observed_.cameras[static_cast<std::size_t>(frame.camera)];
  observed.timing.add(frame.stamp, false);
  if (observed.timing.count > 1) return;
  try {
    const cv::Mat image = frame.decode();
    observed.size = {image.cols, image.rows};
  } catch (const std::exception& e) {
    observed.decode_error = e.what();
  }
}

}  // namespace apvi::doctor
