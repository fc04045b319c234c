// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/dvl_validity.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::io {
namespace {

void reset_unless(bool meaningful, std::optional<double>& value) {
  if (!meaningful) value.reset();
}

// False for NaN.
bool not_negative(const std::optional<double>& value) {
  return value && *value >= 0.0 && std::isfinite(*value);
}

// No DVL measures more. Devices write the limit of a 16-bit number of mm/s (-32.768) for "none".
constexpr double kMaxSpeed = 30.0;          // [m/s]
constexpr double kMaxFigureOfMerit = 10.0;  // [m/s]; Nortek's for "none"

}  // namespace

bool is_placeholder(const DvlSample& sample) {
  return sample.velocity.cwiseAbs().maxCoeff() > kMaxSpeed ||
         sample.figure_of_merit.value_or(0.0) >= kMaxFigureOfMerit;
}

bool infer_validity(const DvlSample& sample) {
  const bool any_beam = std::any_of(sample.beams.begin(), sample.beams.end(),
                                    [](const auto& beam) { return beam && beam->velocity != 0.0; });
  return any_beam || !sample.velocity.isZero(0.0);
}

void clear_placeholder_values(DvlSample& sample) {
  sample.valid = sample.valid && !is_placeholder(sample);
  if (!sample.valid && !sample.velocity.allFinite()) sample.velocity.setZero();
  reset_unless(not_negative(sample.figure_of_merit), sample.figure_of_merit);
  reset_unless(not_negative(sample.altitude), sample.altitude);
  for (auto& beam : sample.beams) {
    if (!beam) continue;
    if (!std::isfinite(beam->velocity) || std::abs(beam->velocity) > kMaxSpeed) {
      beam->velocity = 0.0;
      beam->valid = false;
    }
    reset_unless(not_negative(beam->range), beam->range);
  }
}

}  // namespace apvi::io
