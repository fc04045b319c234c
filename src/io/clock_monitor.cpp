// SPDX-License-Identifier: BSD-3-Clause
#include "io/clock_monitor.hpp"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <utility>

#include "apvi/core/log.hpp"

namespace apvi::io {
namespace {

constexpr Duration kDay{86'400'000'000'000};

// Sensors whose clock was set at once have their last samples before it within this time.
constexpr Duration kSameTime{2'000'000'000};

// A clock that was set steps back by more; samples out of order by less come late.
constexpr Duration kSetBack{1'000'000'000};

// Samples read ahead to see whether a clock returns.
constexpr std::size_t kMaxHeld = 20'000;
constexpr std::size_t kMaxHeldImages = 256;  // a bag holds their bytes

Duration size_of(Duration step) {
  return step < Duration{0} ? -step : step;
}

void shift_stamp(SensorEvent& event, Duration shift) {
  std::visit([shift](auto& sample) { sample.stamp = sample.stamp + shift; }, event);
}

}  // namespace

ClockMonitor::ClockMonitor(const std::vector<std::string>& kinds, Duration max_jump)
    : max_jump_(max_jump) {
  for (const std::string& kind : kinds) {
    sensors_.emplace_back();
    sensors_.back().kind = kind;
  }
}

SourceState ClockMonitor::next(std::size_t index, SampleSource& source, SensorEvent& event,
                               const Drop& drop) {
  Sensor& sensor = sensors_[index];
  for (;;) {
    const bool open = sensor.state == State::jumped && !resolve(sensor, drop);
    if (sensor.state == State::regular && !sensor.held.empty()) return deliver(sensor, event);
    if (open && (sensor.ended || sensor.returned || is_full(sensor))) return SourceState::pending;
    SensorEvent read;
    const SourceState state = source.next(read);
    if (state == SourceState::sample) {
      take(sensor, std::move(read));
      continue;
    }
    if (state != SourceState::end) return state;
    sensor.ended = true;
    if (sensor.state == State::suspect) sensor.state = State::regular;  // a single last sample
    if (sensor.state == State::regular && sensor.held.empty()) return SourceState::end;
  }
}

void ClockMonitor::put_back(std::size_t index, std::deque<SensorEvent> next) {
  for (SensorEvent& event : next) sensors_[index].held.push_back(std::move(event));
}

void ClockMonitor::restart(std::size_t index, SensorEvent next) {
  Sensor& sensor = sensors_[index];
  sensor.held.clear();
  sensor.held.push_back(std::move(next));
  sensor.last.reset();
  sensor.candidate.reset();
  sensor.state = State::regular;
}

void ClockMonitor::leave_out(std::size_t index) {
  Sensor& sensor = sensors_[index];
  sensor.held.clear();
  sensor.last.reset();
  sensor.state = State::regular;
  sensor.ended = true;
}

void ClockMonitor::take(Sensor& sensor, SensorEvent event) {
  const Stamp stamp = stamp_of(event);
  const bool jumps = sensor.last && is_jump(*sensor.last, stamp);
  if (sensor.state == State::jumped) {
    sensor.returned = !jumps;
    sensor.stepped = !jumps && steps_back_to_clock(sensor, stamp);
    if (!jumps) sensor.away = sensor.latest - *sensor.jump;
  } else if (sensor.state == State::suspect) {
    const Stamp first = stamp_of(sensor.held.front());
    sensor.state = jumps && is_near(stamp, first) ? State::jumped : State::regular;
    if (sensor.state == State::jumped) sensor.jump = first;
  } else if (jumps) {
    sensor.state = State::suspect;
  }
  sensor.latest = stamp;
  sensor.held.push_back(std::move(event));
}

// A clock that returns makes a step as large as the first one. One that was set back comes to the
// stamps before it as well, but step by step.
bool ClockMonitor::steps_back_to_clock(const Sensor& sensor, Stamp stamp) {
  return 2 * size_of(stamp - sensor.latest).ns > size_of(*sensor.last - *sensor.jump).ns;
}

bool ClockMonitor::is_full(const Sensor& sensor) {
  const bool is_image =
      !sensor.held.empty() && std::holds_alternative<ImageFrame>(sensor.held.front());
  return sensor.held.size() >= (is_image ? kMaxHeldImages : kMaxHeld);
}

SourceState ClockMonitor::deliver(Sensor& sensor, SensorEvent& event) {
  event = std::move(sensor.held.front());
  sensor.held.pop_front();
  const Stamp stamp = stamp_of(event);
  // A single sample far from its neighbors is left to the stream cleaner.
  const bool regular = (sensor.last && is_near(*sensor.last, stamp)) ||
                       (sensor.candidate && is_near(*sensor.candidate, stamp));
  if (regular) sensor.last = stamp;
  sensor.candidate = stamp;
  shift_stamp(event, shift_);
  return SourceState::sample;
}

bool ClockMonitor::is_near(Stamp a, Stamp b) const {
  return (a > b ? a - b : b - a) <= max_jump_;
}

bool ClockMonitor::is_jump(Stamp from, Stamp to) const {
  return from - to > std::min(max_jump_, kSetBack) || to - from > kDay;
}

bool ClockMonitor::all_jumped() const {
  return std::all_of(sensors_.begin(), sensors_.end(), [](const Sensor& sensor) {
    return sensor.state == State::jumped || (sensor.ended && sensor.held.empty());
  });
}

// How long the others continued after the last regular sample of a sensor.
Duration ClockMonitor::progress_of_others(const Sensor& sensor) const {
  Duration progress{0};
  for (const Sensor& other : sensors_) {
    if (other.last) progress = std::max(progress, *other.last - *sensor.last);
  }
  return progress;
}

void ClockMonitor::drop_front(Sensor& sensor, const Drop& drop) {
  sensor.held.pop_front();
  ++sensor.dropped;
  drop();
}

bool ClockMonitor::others_ended(const Sensor& sensor) const {
  return std::all_of(sensors_.begin(), sensors_.end(), [&](const Sensor& other) {
    return &other == &sensor || (other.ended && other.held.empty());
  });
}

// Whether another sensor went on to its end on the old clock.
bool ClockMonitor::others_continued(const Sensor& sensor) const {
  return std::any_of(sensors_.begin(), sensors_.end(), [&](const Sensor& other) {
    const bool ended = other.state != State::jumped && other.ended && other.held.empty();
    return ended && other.last && *other.last - *sensor.last > kSameTime;
  });
}

// Whether every sensor that jumped was read to where its clock returns, or as far as possible.
bool ClockMonitor::all_settled() const {
  return std::all_of(sensors_.begin(), sensors_.end(), [](const Sensor& sensor) {
    return sensor.state != State::jumped || sensor.ended || sensor.returned || is_full(sensor);
  });
}

// Whether all made a step back to the clock before; those that ended cannot.
bool ClockMonitor::all_stepped() const {
  return std::any_of(sensors_.begin(), sensors_.end(), [](const Sensor& s) { return s.stepped; }) &&
         std::all_of(sensors_.begin(), sensors_.end(),
                     [](const Sensor& s) { return s.stepped || (s.ended && !s.returned); });
}

void ClockMonitor::drop_overtaken(Sensor& sensor, Duration progress, bool all, const Drop& drop) {
  while (sensor.held.size() > (sensor.returned ? 1U : 0U)) {
    const Duration since_jump = stamp_of(sensor.held.front()) - *sensor.jump;
    if (!all && since_jump + max_jump_ >= progress) return;
    drop_front(sensor, drop);
  }
}

bool ClockMonitor::resolve(Sensor& sensor, const Drop& drop) {
  const Duration progress = progress_of_others(sensor);
  const bool is_all = all_jumped();
  const bool contradicted = is_all && others_continued(sensor);
  const bool overtaken = progress > max_jump_ && (!is_all || others_ended(sensor));
  const bool passed = sensor.returned && !is_all && progress > sensor.away;
  if (contradicted || overtaken || passed) {
    const bool all = contradicted || passed || others_ended(sensor);
    drop_overtaken(sensor, progress, all, drop);
    return end_alone(sensor);
  }
  if (!is_all || !all_settled()) return false;
  if (all_stepped()) {
    correct_excursion();
  } else {
    set_clock();
  }
  return true;
}

// A sensor that jumped alone goes on where its clock returns. False before that.
bool ClockMonitor::end_alone(Sensor& sensor) {
  if (sensor.returned && sensor.held.size() == 1) {
    return_to_clock(sensor);
    return true;
  }
  if (!sensor.ended || !sensor.held.empty()) return false;
  sensor.state = State::regular;
  log::warning("{}: its clock jumped while the others continued; the last {} samples are dropped",
               sensor.kind, sensor.dropped);
  return true;
}

// How far all clocks were set, by the sensor with the shortest step between samples: before both
// jumps it made one.
Duration ClockMonitor::excursion() const {
  Duration shift{0};
  Duration shortest{std::numeric_limits<std::int64_t>::max()};
  for (const Sensor& sensor : sensors_) {
    if (!sensor.stepped || sensor.held.size() < 2) continue;
    const Duration away = *sensor.last - *sensor.jump;
    const Duration back =
        stamp_of(sensor.held.back()) - stamp_of(sensor.held[sensor.held.size() - 2]);
    if (size_of(back - away) >= shortest) continue;
    shortest = size_of(back - away);
    shift = Duration{away.ns / 2 + back.ns / 2};
  }
  return shift;
}

void ClockMonitor::correct_excursion() {
  const Duration shift = excursion();
  Duration span{0};
  Stamp begin = Stamp::min();
  for (Sensor& sensor : sensors_) {
    if (sensor.state != State::jumped) continue;
    const std::size_t count = sensor.held.size() - (sensor.returned ? 1 : 0);
    for (std::size_t i = 0; i < count; ++i) shift_stamp(sensor.held[i], shift);
    begin = std::max(begin, *sensor.last);
    span = std::max(span, stamp_of(sensor.held.back()) - *sensor.last);
    sensor.state = State::regular;
    sensor.returned = sensor.stepped = false;
  }
  log::warning(
      "the clock of all sensors was set by {:.1f} s at {:.3f} s, and back after {:.1f} s; the "
      "stamps between are corrected",
      -shift.seconds(), begin.seconds(), span.seconds());
}

void ClockMonitor::set_clock() {
  Stamp last = Stamp::min();
  Stamp first = Stamp::max();
  for (const Sensor& sensor : sensors_) {
    if (sensor.last) last = std::max(last, *sensor.last);
    const bool jumped = sensor.state == State::jumped && !sensor.held.empty();
    if (jumped) first = std::min(first, stamp_of(sensor.held.front()));
  }
  if (first < last) {
    shift_ = shift_ + (last - first) + kClockSetPause;
    log::warning(
        "the clock of all sensors was set back by {:.1f} s at {:.3f}; later stamps are shifted by "
        "{:.1f} s",
        seconds_between(first, last), last.seconds(), shift_.seconds());
  }
  for (Sensor& sensor : sensors_) {
    if (sensor.state == State::jumped) {
      sensor.state = State::regular;
      sensor.returned = sensor.stepped = false;
      sensor.last = *sensor.jump;
    } else {
      sensor.last.reset();  // ended: its stamps say nothing about the new clock
    }
  }
}

void ClockMonitor::return_to_clock(Sensor& sensor) {
  if (++sensor.returns == 1) {
    log::warning("{}: its clock jumped while the others continued; {} samples dropped until {:.3f}",
                 sensor.kind, sensor.dropped, stamp_of(sensor.held.front()).seconds());
  }
  sensor.dropped = 0;
  sensor.returned = sensor.stepped = false;
  sensor.state = State::regular;
}

}  // namespace apvi::io
