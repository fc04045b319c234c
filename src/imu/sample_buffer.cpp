// SPDX-License-Identifier: BSD-3-Clause
#include "imu/sample_buffer.hpp"

#include <algorithm>

namespace apvi::imu {
namespace {

ImuSample interpolate(const ImuSample& a, const ImuSample& b, Stamp stamp) {
  const double u = seconds_between(a.stamp, stamp) / seconds_between(a.stamp, b.stamp);
  return {stamp, a.gyro + u * (b.gyro - a.gyro), a.accel + u * (b.accel - a.accel)};
}

bool is_older(const ImuSample& sample, Stamp stamp) {
  return sample.stamp < stamp;
}

bool is_newer(Stamp stamp, const ImuSample& sample) {
  return stamp < sample.stamp;
}

}  // namespace

bool SampleBuffer::add(const ImuSample& sample) {
  if (!samples_.empty() && sample.stamp <= samples_.back().stamp) return false;
  samples_.push_back(sample);
  drop_before(sample.stamp - retention_);
  return true;
}

void SampleBuffer::drop_before(Stamp stamp) {
  while (samples_.size() > 1 && samples_[1].stamp <= stamp) samples_.pop_front();
}

std::optional<Stamp> SampleBuffer::newest() const {
  if (samples_.empty()) return std::nullopt;
  return samples_.back().stamp;
}

std::optional<Stamp> SampleBuffer::oldest() const {
  if (samples_.empty()) return std::nullopt;
  return samples_.front().stamp;
}

std::optional<ImuSample> SampleBuffer::at(Stamp stamp) const {
  const auto next = std::lower_bound(samples_.begin(), samples_.end(), stamp, is_older);
  if (next == samples_.end()) return std::nullopt;
  if (next->stamp == stamp) return *next;
  if (next == samples_.begin()) return std::nullopt;
  return interpolate(*std::prev(next), *next, stamp);
}

double SampleBuffer::step_at(Stamp stamp) const {
  const auto next = std::upper_bound(samples_.begin(), samples_.end(), stamp, is_newer);
  if (next == samples_.begin() || next == samples_.end()) return 0.0;
  return seconds_between(std::prev(next)->stamp, next->stamp);
}

std::vector<ImuSample> SampleBuffer::between(Stamp from, Stamp to) const {
  if (from >= to) return {};
  const auto first = at(from);
  const auto last = at(to);
  if (!first || !last) return {};
  std::vector<ImuSample> span{*first};
  auto next = std::lower_bound(samples_.begin(), samples_.end(), from + Duration{1}, is_older);
  for (; next != samples_.end() && next->stamp < to; ++next) span.push_back(*next);
  span.push_back(*last);
  return span;
}

}  // namespace apvi::imu
