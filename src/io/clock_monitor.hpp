// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/sensors/samples.hpp"
#include "io/sample_source.hpp"

namespace apvi::io {

/// Recognizes clocks that jump: backward by more than a second, or forward by more than a day, for
/// two samples or more.
///
/// - All sensors jump: the clock was set. After a jump back all stamps are shifted, so that they
///   increase; the time that passed is unknown, and kClockSetPause is assumed.
/// - All sensors jump and return, within what can be read ahead: the stamps between are corrected.
/// - One sensor jumps while others continue: its samples are dropped until its stamps return.
///
/// A sensor that has jumped is pending until its next samples or the others show which of the three
/// it is. It jumped alone if another one continues for `max_jump`, or until it returns.
class ClockMonitor {
 public:
  static constexpr Duration kClockSetPause{10'000'000'000};
  using Drop = std::function<void()>;  ///< counts a dropped sample

  ClockMonitor(const std::vector<std::string>& kinds, Duration max_jump);

  /// The next sample of a sensor, read from its source.
  SourceState next(std::size_t index, SampleSource& source, SensorEvent& event, const Drop& drop);
  /// Takes samples of a sensor that were read from its source elsewhere; they are the next ones.
  void put_back(std::size_t index, std::deque<SensorEvent> next);
  /// Forgets the samples of a sensor before the given one.
  void restart(std::size_t index, SensorEvent next);
  /// Forgets a sensor, which is not read any more: its clock says nothing about the others.
  void leave_out(std::size_t index);

 private:
  enum class State { regular, suspect, jumped };
  struct Sensor {
    std::string kind;
    State state = State::regular;
    std::optional<Stamp> last;       // regular sample, as recorded
    std::optional<Stamp> candidate;  // for `last`, far from it
    std::optional<Stamp> jump;       // first sample after the jump
    Stamp latest;                    // sample that was read
    bool returned = false;           // the last of `held` is on the clock again
    bool stepped = false;            // it did so by a step as large as the jump
    Duration away;                   // until then
    std::deque<SensorEvent> held;
    std::size_t dropped = 0;
    std::size_t returns = 0;  // only the first is logged; the drops are counted
    bool ended = false;
  };

  static bool is_full(const Sensor& sensor);
  static bool steps_back_to_clock(const Sensor& sensor, Stamp stamp);
  bool is_near(Stamp a, Stamp b) const;
  bool is_jump(Stamp from, Stamp to) const;
  bool all_jumped() const;
  bool all_settled() const;
  bool all_stepped() const;
  bool others_ended(const Sensor& sensor) const;
  bool others_continued(const Sensor& sensor) const;
  Duration progress_of_others(const Sensor& sensor) const;
  Duration excursion() const;
  void take(Sensor& sensor, SensorEvent event);
  void drop_front(Sensor& sensor, const Drop& drop);
  void drop_overtaken(Sensor& sensor, Duration progress, bool all, const Drop& drop);
  static bool end_alone(Sensor& sensor);
  /// False while it is open what the jump of a sensor was.
  bool resolve(Sensor& sensor, const Drop& drop);
  void set_clock();
  void correct_excursion();
  static void return_to_clock(Sensor& sensor);
  SourceState deliver(Sensor& sensor, SensorEvent& event);

  Duration max_jump_;
  Duration shift_;
  std::vector<Sensor> sensors_;
};

}  // namespace apvi::io
