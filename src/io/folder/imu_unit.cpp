// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/imu_unit.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <string_view>

#include "apvi/core/constants.hpp"
#include "apvi/core/log.hpp"
#include "core/median.hpp"
#include "io/folder/units.hpp"

namespace apvi::io {
namespace {

constexpr std::size_t kFewSamples = 20;  // less say nothing
constexpr std::size_t kEnoughForDegrees = 200;
constexpr std::size_t kMaxKept = 100'000;
constexpr double kTolerance = 0.1;      // of the median norm against gravity
constexpr double kMaxMedianRate = 2.0;  // no vehicle keeps turning so fast [rad/s]
constexpr double kMaxTurn = 0.3;        // of gravity, as a fraction of the gyro's, in deg/s

// The unit in which the norm is nearest gravity; nullptr when none is near.
const Unit* unit_of_gravity(double norm) {
  const Unit* best = nullptr;
  double nearest = kTolerance;
  for (const std::string_view name : {"m/s^2", "g", "mg", "cm/s^2", "mm/s^2"}) {
    const Unit* unit = find_unit(Dimension::acceleration, name);
    const double off = std::abs(norm * unit->to_si / kStandardGravity - 1.0);
    if (off >= nearest) continue;
    best = unit;
    nearest = off;
  }
  return best;
}

void check_rate(double rate, const std::string& source) {
  if (rate <= kMaxMedianRate) return;
  log::warning(
      "{}: median angular rate {:.3g} rad/s: no vehicle turns so fast; for deg/s name the unit, in "
      "the header of a csv: w_x [deg/s]",
      source, rate);
}

// Devices that report milli-g may report mrad/s, so their rates say nothing.
bool is_in_degrees(const ImuEvidence& evidence) {
  const double rate = evidence.magnitudes.median_rate();
  if (rate <= kMaxMedianRate || rate * kRadiansPerDegree > kMaxMedianRate) return false;
  const Unit* accel = unit_of_gravity(evidence.magnitudes.median_force());
  return accel != nullptr && accel->to_si >= 1.0 && evidence.turn.ratio() < kMaxTurn;
}

}  // namespace

void ImuMagnitudes::add(double rate, double force) {
  if (!std::isfinite(rate) || !std::isfinite(force) || seen_++ % every_ != 0) return;
  rates_.push_back(rate);
  forces_.push_back(force);
  if (forces_.size() < kMaxKept) return;
  for (std::size_t i = 0; 2 * i < forces_.size(); ++i) {
    rates_[i] = rates_[2 * i];
    forces_[i] = forces_[2 * i];
  }
  rates_.resize(kMaxKept / 2);
  forces_.resize(kMaxKept / 2);
  every_ *= 2;
}

double ImuMagnitudes::median_rate() const {
  return median(rates_);
}

double ImuMagnitudes::median_force() const {
  return median(forces_);
}

double accel_factor(const ImuMagnitudes& magnitudes, bool has_accel_unit, bool has_gyro_unit,
                    const std::string& source) {
  if (magnitudes.count() < kFewSamples) return 1.0;
  if (!has_gyro_unit) check_rate(magnitudes.median_rate(), source);
  const double force = magnitudes.median_force();
  const Unit* unit = unit_of_gravity(force);
  if (unit == nullptr) {
    if (force >= 0.3 * kStandardGravity) return 1.0;
    log::warning(
        "{}: median specific force {:.3g} m/s²: gravity is missing; log the raw specific "
        "force of the accelerometer, and check its unit",
        source, force);
    return 1.0;
  }
  if (unit->to_si == 1.0) return 1.0;
  if (has_accel_unit) {
    log::warning(
        "{}: median specific force {:.4g} m/s² in the unit of the header, which may be "
        "wrong: these look like [{}]",
        source, force, unit->name);
    return 1.0;
  }
  log::warning(
      "{}: median specific force {:.4g} and no stated unit: taken as {} and converted to m/s²; the "
      "header of a csv may state it: a_x [{}]",
      source, force, unit->name, unit->name);
  return unit->to_si;
}

void ImuEvidence::add(const ImuSample& sample) {
  magnitudes.add(sample.gyro.norm(), sample.accel.norm());
  turn.add(sample);
}

ImuFactors imu_factors(const ImuEvidence& evidence, StatedUnits stated, const std::string& source) {
  ImuFactors factors;
  const bool enough = evidence.magnitudes.count() >= kEnoughForDegrees;
  const bool degrees = !stated.gyro && enough && is_in_degrees(evidence);
  if (degrees) {
    factors.gyro = kRadiansPerDegree;
    log::warning(
        "{}: median angular rate {:.3g}: no vehicle turns so fast in rad/s, and gravity does not "
        "turn so in the accelerations: taken as deg/s and converted to rad/s",
        source, evidence.magnitudes.median_rate());
  }
  factors.accel = accel_factor(evidence.magnitudes, stated.accel, stated.gyro || degrees, source);
  return factors;
}

}  // namespace apvi::io
