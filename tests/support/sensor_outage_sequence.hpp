// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <utility>

#include "apvi/io/sequence.hpp"

namespace apvi::test {

/// A recording with an outage of one sensor.
class SensorOutageSequence : public io::SequenceReader {
 public:
  /// `from_s`, `to_s`: since the first sample of the recording.
  SensorOutageSequence(std::unique_ptr<io::SequenceReader> recording, std::string sensor,
                       double from_s, double to_s)
      : recording_(std::move(recording)),
        sensor_(std::move(sensor)),
        from_s_(from_s),
        to_s_(to_s) {}

  const config::Node& rig() const override { return recording_->rig(); }
  std::optional<SensorEvent> next() override {
    while (auto event = recording_->next()) {
      if (!first_) first_ = stamp_of(*event);
      const double t = seconds_between(*first_, stamp_of(*event));
      if (kind_of(*event) == sensor_ && t >= from_s_ && t < to_s_) continue;
      return event;
    }
    return std::nullopt;
  }
  double fraction() const override { return recording_->fraction(); }
  const std::map<std::string, io::StreamReport>& report() const override {
    return recording_->report();
  }
  std::optional<Trajectory> reference() const override { return recording_->reference(); }

 private:
  std::unique_ptr<io::SequenceReader> recording_;
  std::string sensor_;
  double from_s_;
  double to_s_;
  std::optional<Stamp> first_;
};

}  // namespace apvi::test
