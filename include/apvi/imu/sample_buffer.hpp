// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "apvi/sensors/samples.hpp"

namespace apvi::imu {

/// The inertial samples of the last while, in order of time, for whoever asks about a span of it.
class SampleBuffer {
 public:
  explicit SampleBuffer(Duration keep) : keep_(keep) {}

  /// False, and nothing kept, when the sample is not newer than the last.
  bool add(const ImuSample& sample);
  /// Forgets what is older, but the last sample at or before `stamp`.
  void forget_before(Stamp stamp);

  bool empty() const { return samples_.empty(); }
  std::optional<Stamp> newest() const;
  std::optional<Stamp> oldest() const;

  /// The sample at an instant, interpolated; nothing outside of the buffer.
  std::optional<ImuSample> at(Stamp stamp) const;
  /// The samples of a span with both ends interpolated: two at least. Empty when the buffer does
  /// not cover it or time does not go forward.
  std::vector<ImuSample> between(Stamp from, Stamp to) const;

 private:
  Duration keep_;
  std::deque<ImuSample> samples_;
};

}  // namespace apvi::imu
