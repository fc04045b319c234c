// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "apvi/sensors/samples.hpp"

namespace apvi::imu {

/// Recent IMU samples in chronological order, kept for a retention time.
class SampleBuffer {
 public:
  explicit SampleBuffer(Duration retention) : retention_(retention) {}

  /// Rejects the sample and returns false when it is not newer than the last one.
  bool add(const ImuSample& sample);
  /// Drops older samples, except the last one at or before `stamp`.
  void drop_before(Stamp stamp);

  bool empty() const { return samples_.empty(); }
  std::optional<Stamp> newest() const;
  std::optional<Stamp> oldest() const;

  /// The sample interpolated at `stamp`; nullopt outside the buffered span.
  std::optional<ImuSample> at(Stamp stamp) const;
  /// Time between the measured samples around `stamp` [s]; 0 outside the buffered span.
  double step_at(Stamp stamp) const;
  /// The samples of a span with both ends interpolated, at least two. Empty when the buffer does
  /// not cover the span or `to` is not after `from`.
  std::vector<ImuSample> between(Stamp from, Stamp to) const;

 private:
  Duration retention_;
  std::deque<ImuSample> samples_;
};

}  // namespace apvi::imu
