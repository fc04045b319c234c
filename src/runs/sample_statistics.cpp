// SPDX-License-Identifier: BSD-3-Clause
#include "runs/sample_statistics.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::runs {
namespace {

constexpr double kMinGap_s = 0.5;
constexpr std::size_t kMinConstant = 50;  // samples
constexpr double kMinFrozen_s = 1.0;

bool is_constant(const std::vector<float>& values) {
  if (values.size() < kMinConstant) return false;
  return std::all_of(values.begin(), values.end(), [&](float v) { return v == values.front(); });
}

std::optional<double> quantile(std::vector<float> values, double q) {
  if (values.empty()) return std::nullopt;
  const auto place =
      values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

}  // namespace

void SampleStatistics::add(const SensorEvent& event) {
  const Stamp stamp = stamp_of(event);
  if (!first_) first_ = stamp;
  const double step_s = last_ ? seconds_between(*last_, stamp) : 0.0;
  if (step_s > segment_gap_s_) silent_s_ += step_s;
  last_ = stamp;
  SampleSpan& span =
      spans_.try_emplace(std::string(kind_of(event)), SampleSpan{stamp, stamp, 0}).first->second;
  span.last = stamp;
  ++span.count;
  if (const auto* imu = std::get_if<ImuSample>(&event)) {
    add_pause(imu->stamp);
    add_repetition(*imu);
    accel_.push_back(static_cast<float>(imu->accel.norm()));
    gyro_.push_back(static_cast<float>(imu->gyro.norm()));
  } else if (const auto* ping = std::get_if<DvlSample>(&event)) {
    const auto speed = static_cast<float>(ping->velocity.norm());
    if (ping->valid) dvl_speed_.push_back(speed);
    if (!ping->valid && speed > 0.0F) unlocked_speed_.push_back(speed);
  } else if (const auto* pressure = std::get_if<PressureSample>(&event)) {
    pressure_.push_back(static_cast<float>(pressure->pressure_pa));
  } else if (const auto* depth = std::get_if<PressureDepthSample>(&event)) {
    depth_.push_back(static_cast<float>(depth->depth_m));
  }
}

void SampleStatistics::add_pause(Stamp stamp) {
  const double step_s = last_imu_ ? seconds_between(*last_imu_, stamp) : 0.0;
  if (step_s > segment_gap_s_) {
    pauses_.push_back({*last_imu_, step_s});
  } else if (step_s > kMinGap_s) {
    gaps_.push_back({*last_imu_, step_s});
  }
  last_imu_ = stamp;
}

// A gyro and an accelerometer have noise: all six values at once do not stay the same.
void SampleStatistics::add_repetition(const ImuSample& sample) {
  const bool same =
      unchanged_ && sample.gyro == unchanged_->gyro && sample.accel == unchanged_->accel;
  if (!same) {
    unchanged_ = sample;
    repetitions_ = 0;
    return;
  }
  const double length_s = seconds_between(unchanged_->stamp, sample.stamp);
  if (++repetitions_ < kMinConstant || length_s < kMinFrozen_s) return;
  if (length_s > frozen_imu_.length_s) frozen_imu_ = {unchanged_->stamp, length_s};
}

bool SampleStatistics::has_zero_gyro() const {
  return is_constant(gyro_) && gyro_.front() == 0.0F;
}

bool SampleStatistics::has_constant_depth() const {
  return is_constant(depth_) || is_constant(pressure_);
}

double SampleStatistics::dvl_delay_s() const {
  const auto imu = spans_.find("imu");
  const auto dvl = spans_.find("dvl");
  if (imu == spans_.end() || dvl == spans_.end()) return 0.0;
  const double begin = seconds_between(imu->second.first, dvl->second.first);
  const double end = seconds_between(imu->second.last, dvl->second.last);
  if (begin * end <= 0.0) return 0.0;
  return std::abs(begin) < std::abs(end) ? begin : end;
}

std::optional<double> SampleStatistics::median_accel() const {
  return quantile(accel_, 0.5);
}

std::optional<double> SampleStatistics::median_gyro() const {
  return quantile(gyro_, 0.5);
}

std::optional<double> SampleStatistics::median_dvl_speed() const {
  return quantile(dvl_speed_, 0.5);
}

std::optional<double> SampleStatistics::median_unlocked_speed() const {
  return quantile(unlocked_speed_, 0.5);
}

std::optional<double> SampleStatistics::high_depth() const {
  return quantile(depth_, 0.99);
}

std::optional<double> SampleStatistics::high_dvl_speed() const {
  return quantile(dvl_speed_, 0.99);
}

}  // namespace apvi::runs
