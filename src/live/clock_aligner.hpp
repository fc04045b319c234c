// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>

#include "apvi/core/stamp.hpp"

namespace apvi::live {

/// Maps the clock of a device to that of the host, while messages arrive.
///
/// A message arrives later than it was sent, never earlier. So the lower envelope of
/// `arrival - sent` over the last minute is the offset between the clocks, plus the least delay of
/// the link, which cannot be observed one way. The envelope is the line that supports the lower
/// convex hull at the mean time (Moon, Skelly, Towsley: Estimation and removal of clock skew from
/// network delay measurements, INFOCOM 1999).
///
/// The mapping increases: corrections are slewed by at most 5 % of the time that passes. A step of
/// the device's clock is followed: at once when the clock jumps forward, after a second when it is
/// set back, because a link that stalls looks like that at first. Not thread-safe.
class ClockAligner {
 public:
  /// A message that was sent at `device` on the device's clock arrived at `arrival` on the host's.
  void add(Stamp device, Stamp arrival);

  /// Whether a second of messages has been seen, so that the offset is no longer a guess.
  bool ready() const { return ready_; }
  /// A time of the device on the host's clock. The first `add` must precede it.
  Stamp to_host(Stamp device) const;
  /// How much faster the host's clock runs than the device's, e.g. 50e-6.
  double skew() const { return skew_; }
  std::size_t steps() const { return steps_; }
  /// The size of the last step of the device's clock.
  Duration last_step() const { return last_step_; }

 private:
  struct Point {
    double x = 0.0;  // device time since the origin [s]
    double y = 0.0;  // arrival - device, less that of the origin [s]
  };
  struct Rise {
    Stamp since;  // host's clock
    std::size_t messages = 0;
  };

  Point point_of(Stamp device, Stamp arrival) const;
  double line(double x) const { return intercept_ + skew_ * x; }
  void restart(Stamp device, Stamp arrival);
  bool is_step(double excess, Stamp arrival);
  void insert(const Point& point);
  void fit();
  void slew(double x);

  bool started_ = false;
  bool ready_ = false;
  Stamp origin_;                          // device's clock
  Duration offset_;                       // host - device at the origin
  std::map<std::int64_t, Point> lowest_;  // by bin of device time
  double skew_ = 0.0;
  double intercept_ = 0.0;  // of the envelope [s]
  double applied_x_ = 0.0;
  double applied_y_ = 0.0;  // slewed toward the envelope
  std::optional<Rise> rise_;
  std::size_t steps_ = 0;
  Duration last_step_;
};

}  // namespace apvi::live
