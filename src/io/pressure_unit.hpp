// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string_view>

#include "apvi/io/sequence.hpp"

namespace apvi::io {

/// The unit that a header writes in brackets; nothing for other words.
std::optional<PressureUnit> pressure_unit_of(std::string_view word);

/// Turns a pressure sensor's numbers into pascal. With PressureUnit::automatic the first number
/// decides, once: at least 50000 is Pa, at least 500 is hPa (mbar), less is kPa. That is right for
/// absolute pressure from a mountain lake's surface down to 490 m (hPa) and 40 m (kPa).
class PressureScale {
 public:
  explicit PressureScale(PressureUnit unit) : unit_(unit) {}
  /// `source` names the sensor in the log.
  double to_pascal(double value, std::string_view source);

 private:
  PressureUnit unit_;
};

}  // namespace apvi::io
