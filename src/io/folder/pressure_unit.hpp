// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apvi/io/sequence.hpp"

namespace apvi::io {

/// How the numbers of a pressure sensor become absolute pressure:
/// `value * to_pascal + offset_pa`, within the limits.
struct PressureScale {
  double to_pascal = 1.0;
  double offset_pa = 0.0;  ///< of readings that are above the atmosphere (gauge, sea pressure)
  double lowest_pa = -1e300;
  double highest_pa = 1e300;
  std::string doubt = {};  ///< why the readings may mean something else, as a warning; "" if clear

  double pascal(double value) const { return value * to_pascal + offset_pa; }
  /// False for readings apart from the rest of the recording; true for what is not finite.
  bool is_plausible(double pascal) const { return !(pascal < lowest_pa || pascal > highest_pa); }
};

/// What is known before the readings are.
struct PressureSource {
  std::string name;                             ///< file or topic, for messages
  PressureUnit unit = PressureUnit::automatic;  ///< as configured, or as the header says
  double atmospheric_pa = 101325.0;             ///< as the rig has it; added to gauge readings
  /// By how much the readings grow with each meter of depth, where the DVL tells.
  std::optional<double> growth_per_meter = std::nullopt;
};

/// The unit with this factor to pascal, which is one of the known ones.
PressureUnit unit_of(double to_pascal);

/// Evaluates all readings of a recording. Without a unit it is the one in which they grow with
/// depth as water's pressure does, where that is known. Else it is the one in which their median is
/// an absolute pressure from the surface of a mountain lake down to 490 m (Pa, hPa, kPa: by
/// median), or in which the shallow readings are near the surface (bar, dbar, psi). Readings too
/// small for any absolute pressure are above the atmosphere, with a warning: in dbar if no unit is
/// stated. Fewer than 1 % of the readings, apart from the others by more than 10 m of water, are
/// implausible. Throws InputError when several units are possible.
PressureScale evaluate_pressure(std::vector<double> values, const PressureSource& source);

}  // namespace apvi::io
