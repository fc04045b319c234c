// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>

#include "apvi/core/stamp.hpp"

namespace apvi::importer {

/// Maps the clock of a device to that of the one who logged its messages, over a whole log.
/// Messages arrive late, never early: the offset is the line that supports the lower convex hull of
/// `arrival - sent` at the mean time. What remains in it is the least delay.
class LogClock {
 public:
  /// A message sent at `device` arrived at `arrival`.
  void add(Stamp device, Stamp arrival);
  /// Whether the device was started anew: its clock went back.
  bool is_restart(Stamp device) const;
  /// Ends the messages.
  void fit();
  /// When a message of `device` would have arrived without delay. After `fit`.
  Stamp to_arrival(Stamp device) const;

 private:
  struct Point {
    double x = 0.0;  // device time since the first message [s]
    double y = 0.0;  // arrival - device, less that of the first message [s]
  };
  Point point_of(Stamp device, Stamp arrival) const;

  bool started_ = false;
  Stamp origin_;
  Stamp last_;
  Duration offset_;
  std::map<long, Point> lowest_;  // by second
  double slope_ = 0.0;
  double intercept_ = 0.0;
};

}  // namespace apvi::importer
