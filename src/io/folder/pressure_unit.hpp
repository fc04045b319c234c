// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string_view>

#include "apvi/io/sequence.hpp"

namespace apvi::io {

/// Parses the unit in a header; nullopt for unknown units.
std::optional<PressureUnit> pressure_unit_of(std::string_view word);

/// Converts pressure readings to pascal. With PressureUnit::automatic the first reading determines
/// the unit: at least 50000 is Pa, at least 500 is hPa (mbar), less is kPa. This is correct for
/// absolute pressure from the surface of a mountain lake down to 490 m (hPa) and 40 m (kPa).
class PressureScale {
 public:
  explicit PressureScale(PressureUnit unit) : unit_(unit) {}
  /// `source` names the sensor in the log.
  double to_pascal(double value, std::string_view source);

 private:
  PressureUnit unit_;
};

}  // namespace apvi::io
