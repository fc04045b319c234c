// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>

namespace apvi::sim {

/// Phase function of marine particles: Fournier and Forand, "Analytic phase function for ocean
/// water", Proc. SPIE 2258, 1994, in the form of Fournier and Jonasz (1999), for particles of
/// refractive index `index` with a hyperbolic size distribution of slope `slope`. The defaults
/// scatter 1.83 % backward, as Petzold's measured average does (Mobley, Sundman and Boss, "Phase
/// function effects on oceanic light fields", Applied Optics 41 (6), 2002).
class FournierForand {
 public:
  explicit FournierForand(double index = 1.10, double slope = 3.5835);

  /// Scattered fraction per steradian at an angle, given by its cosine; its integral over the
  /// sphere is 1. It is singular, but integrable, at angle 0.
  double value(double cosine) const;
  /// Fraction scattered by less than `angle_rad`.
  double cumulative(double angle_rad) const;
  double backscatter_fraction() const;

 private:
  double scale_;  ///< delta = scale * sin^2(angle / 2)
  double nu_;
};

/// Light scattered by less than this angle [rad] stays in its pixel.
inline constexpr double kSharpAngle = 0.00872665;  // 0.5 degrees
/// Light scattered by less than this angle [rad] still reaches the image, near the pixel where it
/// belongs: it is the forward-scattering blur, not a loss.
inline constexpr double kSmallAngle = 0.1745329;  // 10 degrees

/// A range of the angles between both: the fraction of the scattering in it, and the root mean
/// square of its angles per axis of the image [rad].
struct AngleClass {
  double fraction = 0.0;
  double rms = 0.0;
};
/// From kSharpAngle on, up to 1.5, 4 and 10 degrees.
const std::array<AngleClass, 3>& small_angle_classes();

/// Fractions of the scattering below kSharpAngle and below kSmallAngle.
double sharp_fraction();
double small_angle_fraction();

}  // namespace apvi::sim
