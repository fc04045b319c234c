// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <functional>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/sensors/samples.hpp"
#include "dipo/eskf.hpp"
#include "dipo/measurements.hpp"

namespace apvi::dipo {

/// Recent history of the filter, so that late measurements (a DVL ping is 0.1 to 0.7 s old) are
/// applied at their own time: the filter is rewound to that time and the inertial data and later
/// measurements are replayed.
class FilterHistory {
 public:
  /// A measurement as a function of the filter at its time.
  using Model = std::function<Measurement(const Eskf&, const Kinematics&)>;

  /// Keeps at least `length` of history. A step longer than `max_step` is a gap in the inertial
  /// data: constant velocity is assumed and the covariance inflated.
  FilterHistory(const imu::EarthModel& world, const CalibrationRandomWalk& walk, Duration length,
                Duration max_step);

  bool started() const { return !steps_.empty(); }
  void start(const ImuSample& sample, const Eskf& filter);
  void clear() { steps_.clear(); }
  /// Propagates to `sample` with the given noise for this step. Stamps must increase.
  void push(const ImuSample& sample, const imu::Noise& noise);

  Stamp oldest() const { return steps_.front().sample.stamp; }
  Stamp newest() const { return steps_.back().sample.stamp; }
  /// True if a measurement at `stamp` can be inserted now: after the oldest, not after the newest.
  bool covers(Stamp stamp) const { return started() && stamp > oldest() && stamp <= newest(); }
  const Eskf& newest_filter() const { return steps_.back().filter; }

  /// The filter at a covered time, with all measurements up to that time applied.
  Eskf filter_at(Stamp stamp) const;
  /// Raw inertial data around `stamp`. The gyro is averaged over a short window, as the lever arm
  /// amplifies its noise and vibration.
  Kinematics kinematics_at(Stamp stamp) const;
  /// Inserts a measurement at its time; with `clone_position` the last-ping clone is set there.
  void insert(Stamp stamp, Model model, bool clone_position = false);

 private:
  struct Entry {
    Stamp stamp;
    Model model;
    bool clone_position = false;
  };
  struct Step {
    ImuSample sample;
    imu::Noise noise;            // noise of the step ending here
    Eskf filter;                 // at the sample, after applying `entries`
    std::vector<Entry> entries;  // measurements after the previous step and not after this one
  };

  std::size_t step_after(Stamp stamp) const;
  void move(Eskf& filter, Stamp from, Stamp to, std::size_t step) const;
  void apply(Eskf& filter, const Entry& entry) const;
  void replay(std::size_t step);

  imu::EarthModel world_;
  CalibrationRandomWalk walk_;
  Duration length_;
  Duration max_step_;
  std::deque<Step> steps_;
};

}  // namespace apvi::dipo
