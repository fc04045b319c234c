// SPDX-License-Identifier: BSD-3-Clause
#include "sensors/sound_speed.hpp"

#include <cmath>
#include <initializer_list>

namespace apvi {
namespace {

// Coefficients in ascending order.
double polynomial(double x, std::initializer_list<double> coefficients) {
  double value = 0.0;
  for (const double* c = coefficients.end(); c != coefficients.begin();) value = value * x + *--c;
  return value;
}

}  // namespace

double sound_speed(double t, double s, double pressure_dbar) {
  const double p = 0.1 * pressure_dbar;  // bar
  const double pure = polynomial(
      p, {polynomial(t, {1402.388, 5.03711, -5.80852e-2, 3.3420e-4, -1.47800e-6, 3.1464e-9}),
          polynomial(t, {0.153563, 6.8982e-4, -8.1788e-6, 1.3621e-7, -6.1185e-10}),
          polynomial(t, {3.1260e-5, -1.7107e-6, 2.5974e-8, -2.5335e-10, 1.0405e-12}),
          polynomial(t, {-9.7729e-9, 3.8504e-10, -2.3643e-12})});
  const double a =
      polynomial(p, {polynomial(t, {1.389, -1.262e-2, 7.164e-5, 2.006e-6, -3.21e-8}),
                     polynomial(t, {9.4742e-5, -1.2580e-5, -6.4885e-8, 1.0507e-8, -2.0122e-10}),
                     polynomial(t, {-3.9064e-7, 9.1041e-9, -1.6002e-10, 7.988e-12}),
                     polynomial(t, {1.100e-10, 6.649e-12, -3.389e-13})});
  const double b = -1.922e-2 - 4.42e-5 * t + (7.3637e-5 + 1.7945e-7 * t) * p;
  const double d = 1.727e-3 - 7.9836e-6 * p;
  return pure + (a + b * std::sqrt(s) + d * s) * s;
}

}  // namespace apvi
