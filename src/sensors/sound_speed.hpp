// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace apvi {

/// Speed of sound in water [m/s] by Chen and Millero 1977 (the UNESCO algorithm; Fofonoff and
/// Millard, UNESCO technical paper 44, 1983). Valid for 0 to 40 degC, 0 to 40 PSU (fresh to
/// sea water), 0 to 10000 dbar (about the depth in meters).
double sound_speed(double temperature_c, double salinity_psu, double pressure_dbar);

}  // namespace apvi
