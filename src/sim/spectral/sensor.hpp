// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>

#include "sim/spectral/spectrum.hpp"

namespace apvi::sim {

enum class SensorType { nikon_d5100, galaxy_s20 };

/// Spectral response of the red, green and blue pixels of a camera, scaled so that a white surface
/// in daylight at the surface (D65, irradiance 1) has the raw values 1, 1, 1.
struct Sensor {
  std::array<Spectrum, 3> response{};  ///< red, green, blue

  /// Raw values of a spectrum.
  Eigen::Vector3d raw(const Spectrum& light) const;
};

/// Nikon D5100: Darrodi, Finlayson, Goodman and Mackiewicz, "Reference data set for camera spectral
/// sensitivity estimation", JOSA A 32 (3), 2015 (measured at NPL). Samsung Galaxy S20: Tominaga,
/// Nishi and Ohtera, "Measurement and estimation of spectral sensitivity functions for mobile phone
/// cameras", Sensors 21 (15), 4985, 2021 (CC BY). Both averaged over the bands.
Sensor make_sensor(SensorType type);

/// Spectrum of daylight, scaled as for `Sensor`: it sums to the raw values 1, 1, 1 in every sensor.
Spectrum daylight_spectrum();

/// Three smooth reflectances that add up to 1 everywhere, so that gray stays gray: the reflectance
/// of a material of albedo (r, g, b) is r * basis[0] + g * basis[1] + b * basis[2]. Blue ends at
/// 495 nm and red begins at 585 nm, both over about 60 nm.
std::array<Spectrum, 3> reflectance_basis();

/// Matrix from white-balanced raw values to colors in which the three basis reflectances have the
/// values (1,0,0), (0,1,0) and (0,0,1) in daylight. Its rows add up to 1.
Eigen::Matrix3d color_matrix(const Sensor& sensor);

}  // namespace apvi::sim
