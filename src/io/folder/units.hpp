// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// The units that text inputs may name, and their conversion to SI. The only home of these factors.
namespace apvi::io {

enum class Dimension { time, length, speed, acceleration, angular_rate, pressure };

struct Unit {
  std::string_view name;
  Dimension dimension;
  double to_si;        ///< factor to s, m, m/s, m/s², rad/s or Pa
  int time_power = 0;  ///< of a time: its length as a power of ten of nanoseconds
};

/// The unit of this dimension with this name, in any usual spelling ("m s^-1", "M/S", "m/sec");
/// nullptr when it is unknown.
const Unit* find_unit(Dimension dimension, std::string_view word);
/// The same in any dimension.
const Unit* find_unit(std::string_view word);
/// The names of a dimension, for messages: "[m], [mm], …".
std::string known_units(Dimension dimension);

/// The unit of stamps without a stated one, by the size of the first and the median step of the
/// series: seconds have decimals or are small; epochs in ms, us and ns differ by factors of 1000.
/// `fallback` when neither tells. Returns the power of ten of nanoseconds: 9, 6, 3 or 0.
int guess_time_power(const std::vector<std::string>& stamps, int fallback);

/// The median of the positive steps of stamps, as written; 0 when there is none.
double median_time_step(const std::vector<std::string>& stamps);

}  // namespace apvi::io
