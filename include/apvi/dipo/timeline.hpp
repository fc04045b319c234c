// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <functional>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/dipo/eskf.hpp"
#include "apvi/dipo/measurements.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::dipo {

/// The filter's recent past, so that a measurement that arrives late (a DVL ping is 0.1 to 0.7 s
/// old) takes effect at its own time: the state goes back there, takes it in, and inertial data and
/// later measurements are played again.
class Timeline {
 public:
  /// A measurement as a function of the filter at its time.
  using Model = std::function<Measurement(const Eskf&, const Kinematics&)>;

  /// Keeps at least `length` of history. A step longer than `max_step` is a gap in the inertial
  /// data: the vehicle is assumed to go on, and the filter told that it knows little.
  Timeline(const imu::World& world, const CalibrationWalk& walk, Duration length,
           Duration max_step);

  bool started() const { return !steps_.empty(); }
  void start(const ImuSample& sample, const Eskf& filter);
  /// Propagates to `sample`, with the noise of this span. Stamps must increase.
  void push(const ImuSample& sample, const imu::Noise& noise);

  Stamp oldest() const { return steps_.front().sample.stamp; }
  Stamp newest() const { return steps_.back().sample.stamp; }
  /// Whether a measurement at `stamp` can be inserted now: after the oldest, not after the newest.
  bool covers(Stamp stamp) const { return started() && stamp > oldest() && stamp <= newest(); }
  const Eskf& newest_filter() const { return steps_.back().filter; }

  /// The filter at a time that the timeline covers, everything up to then taken in.
  Eskf filter_at(Stamp stamp) const;
  /// Raw inertial data around `stamp`: the gyro averaged over a short span, because its noise and
  /// vibration are multiplied by the lever arm.
  Kinematics kinematics_at(Stamp stamp) const;
  /// Takes a measurement in at its time; `clone_position` then makes the last-ping clone there.
  void insert(Stamp stamp, Model model, bool clone_position = false);

 private:
  struct Entry {
    Stamp stamp;
    Model model;
    bool clone_position = false;
  };
  struct Step {
    ImuSample sample;
    imu::Noise noise;            // of the span that ends here
    Eskf filter;                 // at the sample, after `entries`
    std::vector<Entry> entries;  // later than the step before, not later than this one
  };

  std::size_t step_after(Stamp stamp) const;
  void move(Eskf& filter, Stamp from, Stamp to, std::size_t step) const;
  void take_in(Eskf& filter, const Entry& entry) const;
  void replay(std::size_t step);

  imu::World world_;
  CalibrationWalk walk_;
  Duration length_;
  Duration max_step_;
  std::deque<Step> steps_;
};

}  // namespace apvi::dipo
