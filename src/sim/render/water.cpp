// SPDX-License-Identifier: BSD-3-Clause
#include "sim/render/water.hpp"

#include <cmath>

namespace apvi::sim {
namespace {

using Eigen::Vector3d;

struct JerlovRow {
  double k_d[3];   // [1/m] at 600, 525 and 475 nm
  double b_green;  // scattering [1/m]
};

// k_d: Jerlov, "Marine Optics", 2nd edition, Elsevier 1976, table XXVII. Scattering in green:
// fitted to the same types by Solonenko and Mobley, "Inherent optical properties of Jerlov water
// types", Applied Optics 54 (17), 2015, as tabulated for red, green, blue by Droske et al., "Path
// tracing in production: the path of water", SIGGRAPH courses 2023.
constexpr JerlovRow kTypes[] = {
    {{0.235, 0.043, 0.018}, 0.002},  // I
    {{0.240, 0.048, 0.025}, 0.004},  // IA
    {{0.245, 0.054, 0.033}, 0.054},  // IB
    {{0.260, 0.076, 0.062}, 0.365},  // II
    {{0.295, 0.116, 0.116}, 0.998},  // III
    {{0.300, 0.130, 0.170}, 0.372},  // 1C
    {{0.330, 0.200, 0.290}, 1.071},  // 3C
    {{0.400, 0.310, 0.430}, 1.382},  // 5C
    {{0.480, 0.490, 0.710}, 2.394},  // 7C
    {{0.600, 0.780, 1.230}, 3.180},  // 9C
};

// Scattering of red and blue relative to green, common to all types of that table.
const Vector3d kScatterColor(0.74, 1.0, 1.41);
// Fraction of the scattering at such small angles (Petzold's phase functions: half within five
// degrees) that it does not contribute to backscatter.
constexpr double kForwardFraction = 0.4;

// Absorption from k_d and scattering: k_d^2 = a^2 + 0.256 a b (Kirk 1984).
Vector3d absorption(const Vector3d& k_d, const Vector3d& b) {
  const Vector3d half = 0.128 * b;
  return ((half.array().square() + k_d.array().square()).sqrt() - half.array()).matrix();
}

struct Optics {
  Vector3d k_d, a, b;
};

Optics type_optics(JerlovType type) {
  const JerlovRow& row = kTypes[static_cast<int>(type)];
  Optics optics;
  optics.k_d = Vector3d(row.k_d[0], row.k_d[1], row.k_d[2]);
  optics.b = row.b_green * kScatterColor;
  optics.a = absorption(optics.k_d, optics.b);
  return optics;
}

// Scales the particle concentration to reach the requested attenuation of green; absorption is
// scaled too only if it alone exceeds that attenuation.
void set_attenuation_length(Optics& optics, double length_m) {
  const double wanted = 1.0 / length_m;
  const double particles = (wanted - optics.a.y()) / optics.b.y();
  if (particles > 0.0) {
    optics.b *= particles;
  } else {
    const double factor = wanted / (optics.a.y() + optics.b.y());
    optics.a *= factor;
    optics.b *= factor;
  }
}

Vector3d to_vector(const std::array<double, 3>& rgb) {
  return {rgb[0], rgb[1], rgb[2]};
}

}  // namespace

Medium make_medium(const WaterConfig& config, std::optional<double> attenuation_length_m) {
  Optics optics = type_optics(config.type);
  const auto length = attenuation_length_m ? attenuation_length_m : config.attenuation_length_m;
  if (length) set_attenuation_length(optics, *length);
  Medium medium;
  medium.k_d = optics.k_d;
  medium.beta_d = optics.a + optics.b;
  medium.beta_b = optics.a + (1.0 - kForwardFraction) * optics.b;
  if (config.beta_d) medium.beta_d = to_vector(*config.beta_d);
  if (config.beta_b) medium.beta_b = to_vector(*config.beta_b);
  if (attenuation_length_m && (config.beta_d || config.beta_b) && medium.beta_d.y() > 0.0) {
    const double factor = 1.0 / (*attenuation_length_m * medium.beta_d.y());
    medium.beta_d *= factor;
    medium.beta_b *= factor;
  }
  const Vector3d daylight = (-medium.k_d * config.reference_depth_m).array().exp();
  const Vector3d albedo = optics.b.cwiseQuotient(optics.a + optics.b);
  medium.b_inf = config.b_inf ? to_vector(*config.b_inf)
                              : Vector3d(config.veiling_light * albedo.cwiseProduct(daylight));
  return medium;
}

Vector3d apply_medium(const Medium& medium, const Vector3d& clear, double range) {
  const Vector3d direct = (-medium.beta_d * range).array().exp();
  const Vector3d backscatter = 1.0 - (-medium.beta_b * range).array().exp();
  return clear.cwiseProduct(direct) + medium.b_inf.cwiseProduct(backscatter);
}

}  // namespace apvi::sim
