// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/calibration.hpp"

#include <algorithm>
#include <cmath>

#include "fusion/discriminator.hpp"

namespace apvi::fusion {
namespace {

// The largest threshold, at most `edge`, with at most a fraction `fraction` of the values below it.
double lower_to_fraction(double edge, std::vector<double> values, double fraction) {
  const auto allowed = static_cast<std::size_t>(fraction * static_cast<double>(values.size()));
  const auto first_kept = values.begin() + static_cast<std::ptrdiff_t>(allowed);
  std::nth_element(values.begin(), first_kept, values.end());
  return std::min(edge, *first_kept);
}

int directions_above(const Eigenvalues& e, const EigenThresholds& thresholds) {
  return static_cast<int>((e.rotation.array() >= thresholds.rotation).count() +
                          (e.position.array() >= thresholds.position).count());
}

}  // namespace

Eigenvalues normalized(const RecordedFrame& frame, Normalization normalization) {
  return normalization == Normalization::per_inlier ? per_inlier(frame.eigenvalues, frame.inliers)
                                                    : frame.eigenvalues;
}

ThresholdOutcome evaluate_thresholds(const std::vector<RecordedFrame>& frames,
                                     const EigenThresholds& thresholds, Normalization normalization,
                                     int min_directions) {
  ThresholdOutcome result{.frames = frames.size()};
  if (frames.empty()) return result;
  std::size_t rejected = 0;
  std::size_t below_min_directions = 0;
  int directions = 0;
  for (const RecordedFrame& frame : frames) {
    const Eigenvalues e = normalized(frame, normalization);
    const int above = directions_above(e, thresholds);
    rejected += check_degeneracy(e, thresholds).accepted() ? 0 : 1;
    below_min_directions += above < min_directions ? 1 : 0;
    directions += above;
  }
  const double n = static_cast<double>(frames.size());
  result.rejected = static_cast<double>(rejected) / n;
  result.rejected_by_remap = static_cast<double>(below_min_directions) / n;
  result.directions = directions / n;
  return result;
}

std::optional<DegeneracyCalibration> calibrate_degeneracy(const RecordedFrames& frames,
                                                          Normalization normalization,
                                                          double max_false_alarm,
                                                          int min_directions) {
  std::vector<Eigenvalues> samples;
  std::vector<double> rotation;
  std::vector<double> position;
  for (const RecordedFrame& frame : frames.healthy) {
    samples.push_back(normalized(frame, normalization));
    rotation.push_back(samples.back().rotation.minCoeff());
    position.push_back(samples.back().position.minCoeff());
  }
  if (samples.size() < 2) return std::nullopt;
  const auto fit = fit_semicircle(samples);
  if (!fit) return std::nullopt;
  const double fraction = 0.5 * max_false_alarm;
  DegeneracyCalibration result{
      .normalization = normalization,
      .fit = *fit,
      .thresholds = {lower_to_fraction(fit->rotation.lower_edge, rotation, fraction),
                     lower_to_fraction(fit->position.lower_edge, position, fraction)},
      .healthy = {},
      .blind = {},
      .healthy_at_edge = {},
      .blind_at_edge = {}};
  const auto tested = [&](const std::vector<RecordedFrame>& of, const EigenThresholds& thresholds) {
    return evaluate_thresholds(of, thresholds, normalization, min_directions);
  };
  result.healthy = tested(frames.healthy, result.thresholds);
  result.blind = tested(frames.blind, result.thresholds);
  result.healthy_at_edge = tested(frames.healthy, fit->thresholds());
  result.blind_at_edge = tested(frames.blind, fit->thresholds());
  return result;
}

}  // namespace apvi::fusion
