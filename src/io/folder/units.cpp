// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/units.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "apvi/core/constants.hpp"
#include "core/median.hpp"
#include "core/text.hpp"

namespace apvi::io {
namespace {

// The first name of each dimension is SI's. Several names of one unit are several rows.
constexpr std::array kUnits = {
    Unit{"s", Dimension::time, 1.0, 9},
    Unit{"ms", Dimension::time, 1e-3, 6},
    Unit{"us", Dimension::time, 1e-6, 3},
    Unit{"ns", Dimension::time, 1e-9, 0},
    Unit{"m", Dimension::length, 1.0},
    Unit{"cm", Dimension::length, 0.01},
    Unit{"mm", Dimension::length, 0.001},
    Unit{"km", Dimension::length, 1000.0},
    Unit{"ft", Dimension::length, 0.3048},
    Unit{"m/s", Dimension::speed, 1.0},
    Unit{"mps", Dimension::speed, 1.0},
    Unit{"cm/s", Dimension::speed, 0.01},
    Unit{"mm/s", Dimension::speed, 0.001},
    Unit{"km/h", Dimension::speed, 1.0 / 3.6},
    Unit{"ft/s", Dimension::speed, 0.3048},
    Unit{"kn", Dimension::speed, 1852.0 / 3600.0},
    Unit{"kt", Dimension::speed, 1852.0 / 3600.0},
    Unit{"kts", Dimension::speed, 1852.0 / 3600.0},
    Unit{"knot", Dimension::speed, 1852.0 / 3600.0},
    Unit{"knots", Dimension::speed, 1852.0 / 3600.0},
    Unit{"kph", Dimension::speed, 1.0 / 3.6},
    Unit{"fps", Dimension::speed, 0.3048},
    Unit{"mph", Dimension::speed, 0.44704},
    Unit{"m/s^2", Dimension::acceleration, 1.0},
    Unit{"mps2", Dimension::acceleration, 1.0},
    Unit{"cm/s^2", Dimension::acceleration, 0.01},
    Unit{"mm/s^2", Dimension::acceleration, 0.001},
    Unit{"ft/s^2", Dimension::acceleration, 0.3048},
    Unit{"g", Dimension::acceleration, kStandardGravity},
    Unit{"mg", Dimension::acceleration, 0.001 * kStandardGravity},
    Unit{"milli-g", Dimension::acceleration, 0.001 * kStandardGravity},
    Unit{"rad/s", Dimension::angular_rate, 1.0},
    Unit{"mrad/s", Dimension::angular_rate, 0.001},
    Unit{"deg/s", Dimension::angular_rate, kRadiansPerDegree},
    Unit{"dps", Dimension::angular_rate, kRadiansPerDegree},
    Unit{"mdps", Dimension::angular_rate, 0.001 * kRadiansPerDegree},
    Unit{"deg/h", Dimension::angular_rate, kRadiansPerDegree / 3600.0},
    Unit{"rpm", Dimension::angular_rate, 6.0 * kRadiansPerDegree},
    Unit{"Pa", Dimension::pressure, 1.0},
    Unit{"hPa", Dimension::pressure, 1e2},
    Unit{"mbar", Dimension::pressure, 1e2},
    Unit{"kPa", Dimension::pressure, 1e3},
    Unit{"MPa", Dimension::pressure, 1e6},
    Unit{"bar", Dimension::pressure, 1e5},
    Unit{"dbar", Dimension::pressure, 1e4},
    Unit{"psi", Dimension::pressure, 6894.757293168},
    Unit{"psia", Dimension::pressure, 6894.757293168},
};

void replace_all(std::string& text, std::string_view from, std::string_view to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at)) {
    text.replace(at, from.size(), to);
    at += to.size();
  }
}

// One spelling for "m s^-1", "m/sec", "m·s⁻¹" and the like: "m/s".
std::string canonical(std::string_view word) {
  std::string unit = text::to_lower(text::trim(word));
  // "\xB0", "\xB2" and "\xB5" are °, ² and µ in Latin-1.
  constexpr std::array<std::pair<std::string_view, std::string_view>, 38> kSpellings = {{
      {"⁻²", "^-2"},     {"²", "^2"},        {"⁻¹", "^-1"},        {"⁻", "^-"},
      {"µ", "u"},        {"μ", "u"},         {"°", "deg"},         {"·", ""},
      {"\xB0", "deg"},   {"\xB2", "^2"},     {"\xB5", "u"},        {"*", ""},
      {" ", ""},         {"degrees", "deg"}, {"degree", "deg"},    {"radians", "rad"},
      {"radian", "rad"}, {"seconds", "s"},   {"second", "s"},      {"sec", "s"},
      {"meters", "m"},   {"meter", "m"},     {"feet", "ft"},       {"^^", "^"},
      {"s^-2", "/s^2"},  {"s-2", "/s^2"},    {"s^-1", "/s"},       {"s-1", "/s"},
      {"/s/s", "/s^2"},  {".", ""},          {"pascals", "pa"},    {"pascal", "pa"},
      {"hecto", "h"},    {"kilo", "k"},      {"millibar", "mbar"}, {"decibar", "dbar"},
      {"absolute", ""},  {"abs", ""},
  }};
  for (const auto& [from, to] : kSpellings) replace_all(unit, from, to);
  replace_all(unit, "//", "/");
  if (unit.ends_with("/s2")) unit.replace(unit.size() - 1, 1, "^2");
  return unit;
}

bool has_name(const Unit& unit, std::string_view word) {
  if (unit.name == text::trim(word)) return true;
  // Prefixes m and M differ by 1e9, so MPa is known as written only.
  return unit.name != "MPa" && text::to_lower(unit.name) == canonical(word);
}

const Unit* find_if(std::string_view word, const std::optional<Dimension>& dimension) {
  const auto it = std::find_if(kUnits.begin(), kUnits.end(), [&](const Unit& unit) {
    return (!dimension || unit.dimension == *dimension) && has_name(unit, word);
  });
  return it == kUnits.end() ? nullptr : &*it;
}

bool has_fraction(std::string_view stamp) {
  const std::size_t point = stamp.find('.');
  if (point == std::string_view::npos || stamp.find_first_of("eE") != std::string_view::npos) {
    return false;
  }
  return stamp.find_first_not_of('0', point + 1) != std::string_view::npos;
}

// Rows may be out of order.
double median_step(std::vector<double> times) {
  std::sort(times.begin(), times.end());
  std::vector<double> steps;
  for (std::size_t i = 1; i < times.size(); ++i) {
    if (times[i] > times[i - 1]) steps.push_back(times[i] - times[i - 1]);
  }
  return median(std::move(steps));
}

}  // namespace

const Unit* find_unit(Dimension dimension, std::string_view word) {
  return find_if(word, dimension);
}

const Unit* find_unit(std::string_view word) {
  return find_if(word, std::nullopt);
}

std::string known_units(Dimension dimension) {
  std::string names;
  for (const Unit& unit : kUnits) {
    if (unit.dimension != dimension) continue;
    names += fmt::format("{}[{}]", names.empty() ? "" : ", ", unit.name);
  }
  return names;
}

double median_time_step(const std::vector<std::string>& stamps) {
  std::vector<double> times;
  for (const std::string& stamp : stamps) {
    const auto time = text::parse_double(stamp);
    if (time && std::isfinite(*time)) times.push_back(*time);
  }
  return median_step(std::move(times));
}

int guess_time_power(const std::vector<std::string>& stamps, int fallback) {
  std::vector<double> times;
  std::size_t fractions = 0;
  for (const std::string& stamp : stamps) {
    const auto time = text::parse_double(stamp);
    if (!time || !std::isfinite(*time) || *time < 0.0) continue;
    times.push_back(*time);
    fractions += has_fraction(stamp) ? 1 : 0;
  }
  if (times.empty()) return fallback;
  const double first = times.front();
  const double step = median_step(times);
  // Windows of epochs (1998 to 2112), and steps of at most 2 s, that no finer unit has.
  const auto is_epoch = [&](double per_second) {
    return first >= 9e8 * per_second && first <= 4.5e9 * per_second && step <= 2.0 * per_second;
  };
  if (first >= 1e17) return 0;
  if (is_epoch(1e6)) return 3;
  if (is_epoch(1e3)) return 6;
  if (first < 1e11 && 2 * fractions > times.size()) return 9;
  return fallback;
}

}  // namespace apvi::io
