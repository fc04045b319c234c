// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "io/folder/gravity_turn.hpp"

namespace apvi::io {

/// Norms of angular rate and specific force over a recording. Every n-th sample is kept, so that
/// memory stays bounded.
class ImuMagnitudes {
 public:
  void add(double rate, double force);
  std::size_t count() const { return forces_.size(); }
  double median_rate() const;
  double median_force() const;

 private:
  std::vector<double> rates_;
  std::vector<double> forces_;
  std::size_t every_ = 1;
  std::size_t seen_ = 0;
};

/// Factor to m/s² of accelerations whose unit the header does not state: their median norm is that
/// of gravity in g, milli-g, cm/s² or mm/s²; a warning says so. 1 for anything else, with a warning
/// when gravity is not in them, or when the angular rates look like deg/s. `source` names the file.
double accel_factor(const ImuMagnitudes& magnitudes, bool has_accel_unit, bool has_gyro_unit,
                    const std::string& source);

/// Factors to rad/s and m/s².
struct ImuFactors {
  double gyro = 1.0;
  double accel = 1.0;
};

/// Which units the recording names.
struct StatedUnits {
  bool gyro = false;
  bool accel = false;
};

/// What the samples of a recording tell of units that it does not name.
struct ImuEvidence {
  ImuMagnitudes magnitudes;
  GravityTurn turn;

  void add(const ImuSample& sample);
};

/// As `accel_factor`, and the factor of angular rates, which are in deg/s when all of this holds:
/// as rad/s they are more than vehicles turn, as deg/s they are not, gravity turns in the
/// accelerations much less than by them, and the accelerations are in m/s² or g. A warning says so.
ImuFactors imu_factors(const ImuEvidence& evidence, StatedUnits stated, const std::string& source);

}  // namespace apvi::io
