// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/pressure_unit.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/text.hpp"
#include "io/folder/units.hpp"

namespace apvi::io {
namespace {

constexpr double kAtmosphere = 101325.0;      // [Pa]
constexpr double kMinAirPressure = 50'000.0;  // at a mountain lake [Pa]
constexpr double kMaxWeather = 10'000.0;      // below the air pressure of the rig [Pa]
constexpr double kMaxPressure = 1.2e8;        // at the bottom of the ocean [Pa]
constexpr double kPascalPerMeter = 9806.65;
constexpr double kGap = 10.0 * kPascalPerMeter;  // between readings that belong together
constexpr double kMaxApart = 0.01;               // fraction of the readings that is dropped
constexpr double kShallow = 0.1;                 // quantile of the shallow readings
// Zeros are placeholders when the lowest other reading is above this part of the others' median,
// and the others are more than this part of all.
constexpr double kPlaceholderGap = 0.5;
constexpr double kMinOthers = 0.1;
// Where a vehicle that dives from the surface is found in a tenth of a recording [m].
constexpr double kHighest = -1.5;
constexpr double kLowest = 3.0;
constexpr double kDeepDive = 100.0;  // [m]
// Least distance between two units is the factor of 1.45 from psi to dbar.
constexpr double kGrowthTolerance = 1.18;

struct NamedUnit {
  PressureUnit unit;
  std::string_view name;
};
constexpr std::array<NamedUnit, 8> kNames = {{{PressureUnit::pa, "Pa"},
                                              {PressureUnit::hpa, "hPa"},
                                              {PressureUnit::hpa, "mbar"},
                                              {PressureUnit::kpa, "kPa"},
                                              {PressureUnit::mpa, "MPa"},
                                              {PressureUnit::bar, "bar"},
                                              {PressureUnit::dbar, "dbar"},
                                              {PressureUnit::psi, "psi"}}};

std::string_view name_of(PressureUnit unit) {
  return std::find_if(kNames.begin(), kNames.end(),
                      [&](const NamedUnit& n) { return n.unit == unit; })
      ->name;
}

double factor_of(PressureUnit unit) {
  return find_unit(Dimension::pressure, name_of(unit))->to_si;
}

double quantile(const std::vector<double>& sorted, double q) {
  return sorted[static_cast<std::size_t>(q * static_cast<double>(sorted.size() - 1))];
}

// Above the surface of the water when negative [m].
double depth_of(double reading, PressureUnit unit) {
  return (reading * factor_of(unit) - kAtmosphere) / kPascalPerMeter;
}

bool is_near_surface(double shallow, PressureUnit unit) {
  const double depth = depth_of(shallow, unit);
  return depth >= kHighest && depth < kLowest;
}

// The unit in which a tenth of the readings is nearest the surface; automatic: none.
PressureUnit unit_at_surface(double shallow) {
  PressureUnit best = PressureUnit::automatic;
  double nearest = kLowest;
  for (const PressureUnit unit : {PressureUnit::psi, PressureUnit::dbar, PressureUnit::bar}) {
    const double away = std::abs(depth_of(shallow, unit));
    if (!is_near_surface(shallow, unit) || away >= nearest) continue;
    best = unit;
    nearest = away;
  }
  return best;
}

bool is_absolute(double shallow, PressureUnit unit) {
  return shallow * factor_of(unit) >= kMinAirPressure;
}

// The unit in which the readings grow with depth as the pressure of water; automatic: none.
PressureUnit unit_by_growth(const PressureSource& source) {
  if (!source.growth_per_meter) return PressureUnit::automatic;
  for (const auto& [unit, name] : kNames) {
    const double ratio = *source.growth_per_meter * factor_of(unit) / kPascalPerMeter;
    if (ratio < kGrowthTolerance && ratio > 1.0 / kGrowthTolerance) return unit;
  }
  return PressureUnit::automatic;
}

// Deep dives in psi or dbar look like kPa at a mountain lake, and shallow ones above the atmosphere
// like deep ones in the next larger unit. "" when neither may be.
std::string doubt_about(double shallow, PressureUnit unit, const PressureSource& source) {
  if (unit == PressureUnit::kpa &&
      shallow * factor_of(unit) < source.atmospheric_pa - kMaxWeather) {
    return fmt::format(
        "{}: pressures of {:.6g} are taken as kPa, although the rig has {:.6g} Pa of air: for psi "
        "or dbar set dataset.pressure_unit, for a mountain lake atmospheric_pressure_pa of the rig",
        source.name, shallow, source.atmospheric_pa);
  }
  if (unit == PressureUnit::pa || depth_of(shallow, unit) < kLowest) return "";
  const PressureUnit smaller = unit == PressureUnit::kpa ? PressureUnit::hpa : PressureUnit::pa;
  const double gauge_m = shallow * factor_of(smaller) / kPascalPerMeter;
  return fmt::format(
      "{}: pressures of {:.6g} without a unit are taken as {}, {:.1f} m deep; as {} above the "
      "atmosphere they would be {:.2f} m deep: name the unit, or set dataset.pressure_unit",
      source.name, shallow, name_of(unit), depth_of(shallow, unit), name_of(smaller), gauge_m);
}

PressureUnit infer_unit(const std::vector<double>& sorted, const PressureSource& source) {
  if (const PressureUnit unit = unit_by_growth(source); unit != PressureUnit::automatic)
    return unit;
  const double median = quantile(sorted, 0.5);
  const double shallow = quantile(sorted, kShallow);
  using enum PressureUnit;
  const PressureUnit by_median = median >= 50'000.0 ? pa : median >= 500.0 ? hpa : kpa;
  if (median >= 50.0 && is_absolute(shallow, by_median)) return by_median;
  const PressureUnit by_surface = unit_at_surface(shallow);
  if (by_surface != automatic) return by_surface;
  const bool is_ocean = sorted.back() * factor_of(dbar) <= kMaxPressure;
  if (!is_absolute(shallow, bar) && is_ocean) return dbar;
  fail_input(
      "{}: the unit of the pressure cannot be told from its readings (median {:.6g}, a tenth below "
      "{:.6g}); set dataset.pressure_unit, or name it in the header: pressure [bar]",
      source.name, median, shallow);
}

// Zeros among readings that are all far from zero are no measurements, however many there are:
// drivers write them while the sensor does not answer. Zeros of a gauge at the surface are followed
// by small readings.
void remove_placeholders(std::vector<double>& sorted) {
  const auto first = std::upper_bound(sorted.begin(), sorted.end(), 0.0);
  const auto zeros = first - std::lower_bound(sorted.begin(), sorted.end(), 0.0);
  const auto others = sorted.end() - first;
  const auto few = static_cast<std::ptrdiff_t>(kMinOthers * static_cast<double>(sorted.size()));
  if (zeros == 0 || others <= few || sorted.front() < 0.0) return;
  if (*first < kPlaceholderGap * *(first + others / 2)) return;
  sorted.erase(sorted.begin(), first);
}

// The part of the sorted readings around their median without a gap; nothing is cut when more than
// kMaxApart of them would be.
void set_limits(const std::vector<double>& sorted, PressureScale& scale) {
  const auto middle = static_cast<std::ptrdiff_t>((sorted.size() - 1) / 2);
  std::ptrdiff_t first = middle;
  std::ptrdiff_t last = middle;
  const auto pascal = [&](std::ptrdiff_t i) {
    return scale.pascal(sorted[static_cast<std::size_t>(i)]);
  };
  const auto size = static_cast<std::ptrdiff_t>(sorted.size());
  while (first > 0 && pascal(first) - pascal(first - 1) <= kGap) --first;
  while (last + 1 < size && pascal(last + 1) - pascal(last) <= kGap) ++last;
  const auto few =
      static_cast<std::ptrdiff_t>(std::max(1.0, kMaxApart * static_cast<double>(size)));
  // No pressure is negative, and none is above that of the ocean's bottom.
  scale.lowest_pa = first <= few && size > 2 ? pascal(first) : 0.0;
  scale.highest_pa = size - 1 - last <= few && size > 2 ? pascal(last) : kMaxPressure;
}

// Whether the readings are absolute pressures of an ordinary dive in `unit`.
bool is_dive(const std::vector<double>& sorted, PressureUnit unit) {
  return depth_of(quantile(sorted, kShallow), unit) >= kHighest &&
         depth_of(quantile(sorted, 1.0 - kShallow), unit) < kDeepDive;
}

// hPa and kPa are often called Pa. In Pa above the atmosphere, such a dive would never be deeper
// than a meter.
bool is_misnamed(const std::vector<double>& sorted, PressureUnit stated) {
  if (stated == PressureUnit::pa)
    return is_dive(sorted, PressureUnit::hpa) || is_dive(sorted, PressureUnit::kpa);
  return stated == PressureUnit::hpa &&
         is_near_surface(quantile(sorted, kShallow), PressureUnit::kpa);
}

// Absolute pressure is never so small: the atmosphere is missing, unless the stated unit is wrong.
// Returns the warning.
std::string add_atmosphere(double shallow, bool is_wrong_unit, const PressureSource& source,
                           PressureUnit unit, PressureScale& scale) {
  if (is_wrong_unit) {
    return fmt::format(
        "{}: pressures of {:.6g} {} are below that of air: check the unit, see "
        "dataset.pressure_unit",
        source.name, shallow, name_of(unit));
  }
  scale.offset_pa = source.atmospheric_pa;
  const bool guessed = source.unit == PressureUnit::automatic && unit_by_growth(source) != unit;
  return fmt::format(
      "{}: pressures of {:.6g} are below that of air: taken as {} above the atmosphere, "
      "{:.6g} Pa added{}",
      source.name, shallow, name_of(unit), source.atmospheric_pa,
      guessed ? "; set dataset.pressure_unit if it is another unit" : "");
}

// Gauge pressure gets the atmosphere. Says what is not certain.
void settle_offset(const std::vector<double>& sorted, const PressureSource& source,
                   PressureUnit unit, PressureScale& scale) {
  const double shallow = quantile(sorted, kShallow);
  const bool is_stated = source.unit != PressureUnit::automatic;
  const bool is_guess = !is_stated && unit_by_growth(source) != unit;
  std::string text;
  bool is_doubt = is_guess;
  if (!is_absolute(shallow, unit) && source.atmospheric_pa > 0.0) {
    const bool is_wrong = is_stated && is_misnamed(sorted, unit);
    text = add_atmosphere(shallow, is_wrong, source, unit, scale);
    is_doubt = is_guess || is_wrong;
  } else if (is_guess) {
    text = doubt_about(shallow, unit, source);
  }
  if (text.empty()) return;
  log::warning("{}", text);
  if (is_doubt) scale.doubt = std::move(text);
}

}  // namespace

PressureUnit unit_of(double to_pascal) {
  const auto it = std::find_if(kNames.begin(), kNames.end(),
                               [&](const NamedUnit& n) { return factor_of(n.unit) == to_pascal; });
  APVI_CHECK(it != kNames.end());
  return it->unit;
}

PressureScale evaluate_pressure(std::vector<double> values, const PressureSource& source) {
  std::erase_if(values, [](double v) { return !std::isfinite(v); });
  std::sort(values.begin(), values.end());
  remove_placeholders(values);
  const bool guess = source.unit == PressureUnit::automatic;
  if (values.empty()) return {};
  const PressureUnit unit = guess ? infer_unit(values, source) : source.unit;
  PressureScale scale{.to_pascal = factor_of(unit)};
  const double median = quantile(values, 0.5);
  if (guess && unit != PressureUnit::pa) {
    log::info(
        "{}: median pressure is {:.6g}, {} {}{}; otherwise set dataset.pressure_unit", source.name,
        median, unit_by_growth(source) == unit ? "by the DVL's vertical velocity in" : "assuming",
        name_of(unit),
        is_absolute(median, unit) ? fmt::format(", {:.1f} m deep", depth_of(median, unit)) : "");
  }
  settle_offset(values, source, unit, scale);
  set_limits(values, scale);
  return scale;
}

}  // namespace apvi::io
