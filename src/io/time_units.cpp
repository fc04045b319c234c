// SPDX-License-Identifier: BSD-3-Clause
#include "io/time_units.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <utility>

#include "apvi/core/log.hpp"

namespace apvi::io {
namespace {

constexpr std::array<std::pair<int, std::string_view>, 4> kUnits = {
    {{0, "ns"}, {3, "us"}, {6, "ms"}, {9, "s"}}};

// Steps between samples [s]. The usual ones span a factor of 1000, as that of two units, so that
// exactly one unit is usual. No device reports outside the possible ones.
struct Steps {
  std::string_view kind;
  double shortest, usual_from, usual_to, longest;
};
constexpr std::array<Steps, 5> kSteps = {{{"imu", 5e-5, 2e-4, 0.2, 1.0},
                                          {"dvl", 5e-3, 0.02, 20.0, 60.0},
                                          {"camera", 5e-4, 5e-3, 5.0, 600.0},
                                          {"pressure", 5e-4, 2e-3, 2.0, 600.0},
                                          {"depth", 5e-4, 2e-3, 2.0, 600.0}}};

// Times since 1970, from 1998 to 2112 [s].
constexpr double kFirstEpoch = 9e8;
constexpr double kLastEpoch = 4.5e9;

// Of the time that two sensors cover together, the part that both do. A sensor that served for a
// moment covers less than the lower part; in the wrong unit it covers a thousandth, or none.
constexpr double kApart = 0.02;
constexpr double kTogether = 0.5;

std::string_view name_of(int power) {
  return std::ranges::find(kUnits, power, [](const auto& unit) { return unit.first; })->second;
}

struct Sensor {
  Steps steps;
  StampSummary stamps;

  double seconds(double number, int power) const { return number * std::pow(10.0, power - 9); }
  double step(int power) const { return seconds(stamps.step, power); }
  double first(int power) const { return seconds(stamps.first, power); }
  double last(int power) const { return seconds(stamps.last, power); }
  bool is_possible(int power) const {
    return step(power) >= steps.shortest && step(power) <= steps.longest;
  }
  bool is_usual(int power) const {
    return step(power) >= steps.usual_from && step(power) < steps.usual_to;
  }
  bool is_epoch(int power) const {
    return first(power) >= kFirstEpoch && last(power) <= kLastEpoch;
  }
  // "FILE: column NAME says [ns]"
  std::string statement() const {
    return fmt::format("{} {} [{}]", stamps.column, stamps.is_stated ? "says" : "is read as",
                       name_of(stamps.power));
  }
};

// Of the time that either covers, the part that both cover.
double common_part(const Sensor& a, int power_a, const Sensor& b, int power_b) {
  const double common =
      std::min(a.last(power_a), b.last(power_b)) - std::max(a.first(power_a), b.first(power_b));
  const double all =
      std::max(a.last(power_a), b.last(power_b)) - std::min(a.first(power_a), b.first(power_b));
  return all > 0.0 ? std::max(0.0, common) / all : 0.0;
}

// The only other unit for which `fits` holds.
template <typename Fits>
std::optional<int> only_unit(const Sensor& sensor, Fits&& fits) {
  std::optional<int> found;
  for (const auto& [power, name] : kUnits) {
    if (power == sensor.stamps.power || !fits(power)) continue;
    if (found) return std::nullopt;
    found = power;
  }
  return found;
}

std::string advice(int power) {
  return fmt::format("taken as [{}]; correct the header", name_of(power));
}

std::optional<TimeUnitChange> decide_alone(const Sensor& s) {
  const int stated = s.stamps.power;
  if (s.stamps.step <= 0.0 || s.is_usual(stated)) return std::nullopt;
  const bool impossible = !s.is_possible(stated) && !s.is_epoch(stated);
  auto unit = only_unit(s, [&](int power) {
    return s.is_usual(power) && (impossible || (s.is_epoch(power) && !s.is_epoch(stated)));
  });
  if (!unit && !s.is_possible(stated)) {
    unit = only_unit(s, [&](int power) { return s.is_epoch(power) && s.is_possible(power); });
  }
  if (!unit) return std::nullopt;
  return TimeUnitChange{
      *unit, fmt::format("{}, in which its samples are {:.3g} s apart, no rate of a sensor of this "
                         "kind; in [{}] they are {:.3g} s apart{}: {}",
                         s.statement(), s.step(stated), name_of(*unit), s.step(*unit),
                         s.is_epoch(*unit) ? ", and times since 1970" : "", advice(*unit))};
}

std::optional<TimeUnitChange> decide_against(const Sensor& anchor, const Sensor& s) {
  const int stated = s.stamps.power;
  const int time = anchor.stamps.power;
  const bool set_back = s.stamps.last < s.stamps.first || anchor.stamps.last < anchor.stamps.first;
  if (set_back) return std::nullopt;  // the ends say nothing
  if (common_part(anchor, time, s, stated) >= kApart) return std::nullopt;
  const auto unit = only_unit(s, [&](int power) {
    return s.is_possible(power) && common_part(anchor, time, s, power) > kTogether;
  });
  if (!unit) return std::nullopt;
  return TimeUnitChange{
      *unit,
      fmt::format("{}, in which it covers {:.3f} to {:.3f} s, but the {} covers {:.3f} to {:.3f} "
                  "s: {}",
                  s.statement(), s.first(stated), s.last(stated), anchor.steps.kind,
                  anchor.first(time), anchor.last(time), advice(*unit))};
}

std::optional<Sensor> known(const SensorStamps& sensor) {
  const auto* steps = std::ranges::find(kSteps, sensor.kind, &Steps::kind);
  if (steps == kSteps.end() || !sensor.stamps) return std::nullopt;
  return Sensor{*steps, *sensor.stamps};
}

}  // namespace

std::vector<std::optional<TimeUnitChange>> decide_time_units(std::vector<SensorStamps> sensors) {
  std::vector<std::optional<TimeUnitChange>> changes(sensors.size());
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    const auto sensor = known(sensors[i]);
    if (sensor) changes[i] = decide_alone(*sensor);
    if (changes[i]) sensors[i].stamps->power = changes[i]->power;
  }
  // The first in this order has the rate that is told best.
  std::optional<Sensor> anchor;
  for (const Steps& steps : kSteps) {
    const auto found = std::ranges::find(sensors, steps.kind, &SensorStamps::kind);
    if (!anchor && found != sensors.end()) anchor = known(*found);
  }
  for (std::size_t i = 0; anchor && i < sensors.size(); ++i) {
    const auto sensor = known(sensors[i]);
    if (sensor && !changes[i]) changes[i] = decide_against(*anchor, *sensor);
  }
  return changes;
}

std::vector<SettledStamps> settle_time_units(const Recording& recording) {
  std::vector<SensorStamps> sensors;
  for (std::size_t i = 0; i < recording.sources.size(); ++i) {
    sensors.push_back({recording.kinds[i], recording.sources[i]->stamp_summary()});
  }
  const auto changes = decide_time_units(sensors);
  std::vector<SettledStamps> settled;
  for (std::size_t i = 0; i < changes.size(); ++i) {
    const std::string order = sensors[i].stamps ? sensors[i].stamps->order : "";
    settled.push_back({order, sensors[i].stamps});
    if (!order.empty()) log::warning("{}", order);
    if (!changes[i]) continue;
    recording.sources[i]->set_stamp_power(changes[i]->power);
    settled.back() = {changes[i]->remark, recording.sources[i]->stamp_summary()};
    log::warning("{}", changes[i]->remark);
  }
  return settled;
}

}  // namespace apvi::io
