// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <cstddef>
#include <string_view>

#include "apvi/sensors/samples.hpp"

namespace apvi::live {

/// How long a link waits for data, so that a stop is noticed.
inline constexpr std::chrono::milliseconds kPollPeriod{20};

/// A pair of times that a message relates: when it left by the device's clock, when it arrived.
struct ClockReading {
  Stamp sent;
  Stamp arrival;
  std::size_t clock = 0;  ///< of the device, which may stamp messages by more than one
};

/// Takes what a link receives.
class Receiver {
 public:
  virtual ~Receiver() = default;
  /// A sample with its stamp by the device's clock.
  virtual void sample(SensorEvent event, const ClockReading& reading) = 0;
  /// A message that only tells the time.
  virtual void clock(const ClockReading& reading) = 0;
  /// Data that cannot be understood, and why.
  virtual void malformed(std::string_view reason) = 0;
};

/// An open connection to a device. Its constructor connects.
class Link {
 public:
  virtual ~Link() = default;
  /// Waits for data, at most about kPollPeriod, and hands them on. False when there will be no more
  /// (the end of a recording). Throws RunError when the connection is lost.
  virtual bool receive(Receiver& receiver) = 0;
};

}  // namespace apvi::live
