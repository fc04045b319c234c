// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "apvi/sensors/samples.hpp"

namespace apvi::runs {

/// First and last stamp of a sensor.
struct SampleSpan {
  Stamp first;
  Stamp last;
  std::size_t count = 0;

  double length_s() const { return seconds_between(first, last); }
};

/// Magnitudes of the samples of a run: evidence of wrong units. Four bytes per value are kept.
class SampleStatistics {
 public:
  /// A gap between IMU samples that begins a new segment.
  struct Pause {
    Stamp since;
    double length_s = 0.0;
  };

  explicit SampleStatistics(double segment_gap_s = std::numeric_limits<double>::infinity())
      : segment_gap_s_(segment_gap_s) {}

  void add(const SensorEvent& event);

  /// Empty without a sample.
  std::optional<double> median_accel() const;           ///< specific force [m/s²]
  std::optional<double> median_gyro() const;            ///< angular rate [rad/s]
  std::optional<double> median_dvl_speed() const;       ///< of pings with bottom lock [m/s]
  std::optional<double> median_unlocked_speed() const;  ///< of the others, where not zero [m/s]
  /// The depth that 99 % of the samples of depth do not exceed [m].
  std::optional<double> high_depth() const;
  /// The speed that 99 % of the pings with bottom lock do not exceed: without outliers [m/s].
  std::optional<double> high_dvl_speed() const;

  /// Time by which the DVL's recording lies after the IMU's, at its beginning and its end,
  /// whichever is less; negative when it lies before, zero when it does neither [s].
  double dvl_delay_s() const;

  const std::vector<Pause>& pauses() const { return pauses_; }
  /// Gaps between IMU samples that are shorter, but long enough for the vehicle to turn in.
  const std::vector<Pause>& gaps() const { return gaps_; }
  /// Time from the first to the last sample of each kind of sensor.
  const std::map<std::string, SampleSpan>& spans() const { return spans_; }
  /// Whether there are many samples of the gyro, all of them zero.
  bool has_zero_gyro() const;
  /// Whether there are many samples of pressure or depth, all of them the same.
  bool has_constant_depth() const;
  /// The longest time without a change of any value of the IMU, if it is suspicious: a second and
  /// many samples; 0 otherwise [s].
  double frozen_imu_s() const { return frozen_imu_.length_s; }
  Stamp frozen_imu_since() const { return frozen_imu_.since; }
  /// Time in which no sensor reported, in steps longer than the limit of a pause [s].
  double silent_s() const { return silent_s_; }
  std::optional<Stamp> first() const { return first_; }  ///< sample

 private:
  void add_pause(Stamp stamp);
  void add_repetition(const ImuSample& sample);

  double segment_gap_s_;
  std::optional<Stamp> first_;
  std::optional<Stamp> last_;
  double silent_s_ = 0.0;
  std::optional<Stamp> last_imu_;
  std::optional<ImuSample> unchanged_;  // first of the present samples that are the same
  std::size_t repetitions_ = 0;
  Pause frozen_imu_;
  std::vector<Pause> pauses_;
  std::vector<Pause> gaps_;
  std::map<std::string, SampleSpan> spans_;
  std::vector<float> accel_;
  std::vector<float> gyro_;
  std::vector<float> depth_;
  std::vector<float> pressure_;
  std::vector<float> dvl_speed_;
  std::vector<float> unlocked_speed_;
};

}  // namespace apvi::runs
