// SPDX-License-Identifier: BSD-3-Clause
#include "runs/sample_statistics.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::runs {
namespace {

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
  if (const auto* imu = std::get_if<ImuSample>(&event)) {
    add_pause(imu->stamp);
    imu_.add(imu->stamp);
    accel_.push_back(static_cast<float>(imu->accel.norm()));
    gyro_.push_back(static_cast<float>(imu->gyro.norm()));
  } else if (const auto* ping = std::get_if<DvlSample>(&event)) {
    dvl_.add(ping->stamp);
    const auto speed = static_cast<float>(ping->velocity.norm());
    if (ping->valid) dvl_speed_.push_back(speed);
    if (!ping->valid && speed > 0.0F) unlocked_speed_.push_back(speed);
  } else if (const auto* depth = std::get_if<PressureDepthSample>(&event)) {
    depth_.push_back(static_cast<float>(depth->depth_m));
  }
}

void SampleStatistics::add_pause(Stamp stamp) {
  const double step_s = last_imu_ ? seconds_between(*last_imu_, stamp) : 0.0;
  if (step_s > segment_gap_s_) pauses_.push_back({*last_imu_, step_s});
  last_imu_ = stamp;
}

void SampleStatistics::Span::add(Stamp stamp) {
  if (!first) first = stamp;
  last = stamp;
}

double SampleStatistics::dvl_delay_s() const {
  if (!imu_.first || !dvl_.first) return 0.0;
  const double begin = seconds_between(*imu_.first, *dvl_.first);
  const double end = seconds_between(*imu_.last, *dvl_.last);
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
