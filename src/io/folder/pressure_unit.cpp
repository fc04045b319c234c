// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/pressure_unit.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/text.hpp"
#include "io/folder/units.hpp"

namespace apvi::io {
namespace {

constexpr double kAtmosphere = 101325.0;      // [Pa]
constexpr double kMinAirPressure = 50'000.0;  // at a mountain lake [Pa]
constexpr double kMaxPressure = 1.2e8;        // at the bottom of the ocean [Pa]
constexpr double kPascalPerMeter = 9806.65;
constexpr double kGap = 10.0 * kPascalPerMeter;  // between readings that belong together
constexpr double kMaxApart = 0.01;               // fraction of the readings that is dropped
constexpr double kShallow = 0.1;                 // quantile of the shallow readings
// Zeros are placeholders when the lowest other reading is above this part of the median.
constexpr double kPlaceholderGap = 0.5;
// Where a vehicle that dives from the surface is found in a tenth of a recording [m].
constexpr double kHighest = -1.5;
constexpr double kLowest = 3.0;
constexpr double kDeepDive = 100.0;  // [m]

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

PressureUnit infer_unit(const std::vector<double>& sorted, const std::string& name) {
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
      name, median, shallow);
}

// Zeros among readings that are all far from zero are no measurements: drivers write them while the
// sensor does not answer.
void remove_placeholders(std::vector<double>& sorted) {
  const auto first = std::upper_bound(sorted.begin(), sorted.end(), 0.0);
  const auto zeros = first - std::lower_bound(sorted.begin(), sorted.end(), 0.0);
  if (zeros == 0 || 2 * zeros >= std::ssize(sorted) || sorted.front() < 0.0) return;
  if (*first < kPlaceholderGap * quantile(sorted, 0.5)) return;
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
void add_atmosphere(const std::vector<double>& sorted, const PressureSource& source,
                    PressureUnit unit, PressureScale& scale) {
  const double shallow = quantile(sorted, kShallow);
  if (is_absolute(shallow, unit) || source.atmospheric_pa <= 0.0) return;
  const bool guessed = source.unit == PressureUnit::automatic;
  if (!guessed && is_misnamed(sorted, unit)) {
    log::warning(
        "{}: pressures of {:.6g} {} are below that of air: check the unit, see "
        "dataset.pressure_unit",
        source.name, shallow, name_of(unit));
    return;
  }
  scale.offset_pa = source.atmospheric_pa;
  log::warning(
      "{}: pressures of {:.6g} are below that of air: taken as {} above the atmosphere, "
      "{:.6g} Pa added{}",
      source.name, shallow, name_of(unit), source.atmospheric_pa,
      guessed ? "; set dataset.pressure_unit if it is another unit" : "");
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
  const PressureUnit unit = guess ? infer_unit(values, source.name) : source.unit;
  PressureScale scale{.to_pascal = factor_of(unit)};
  const double median = quantile(values, 0.5);
  if (guess && unit != PressureUnit::pa) {
    log::info(
        "{}: median pressure is {:.6g}, assuming {}{}; otherwise set dataset.pressure_unit",
        source.name, median, name_of(unit),
        is_absolute(median, unit) ? fmt::format(", {:.1f} m deep", depth_of(median, unit)) : "");
  }
  add_atmosphere(values, source, unit, scale);
  set_limits(values, scale);
  return scale;
}

}  // namespace apvi::io
