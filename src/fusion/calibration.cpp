// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/fusion/calibration.hpp"

#include <algorithm>
#include <cmath>

#include "apvi/fusion/discriminator.hpp"

namespace apvi::fusion {
namespace {

// The largest threshold, at most `edge`, that at most `share` of the values are below.
double lowered(double edge, std::vector<double> values, double share) {
  const auto allowed = static_cast<std::size_t>(share * static_cast<double>(values.size()));
  const auto first_kept = values.begin() + static_cast<std::ptrdiff_t>(allowed);
  std::nth_element(values.begin(), first_kept, values.end());
  return std::min(edge, *first_kept);
}

int directions_above(const Eigenvalues& e, const EigenThresholds& thresholds) {
  return static_cast<int>((e.rotation.array() >= thresholds.rotation).count() +
                          (e.position.array() >= thresholds.position).count());
}

}  // namespace

Eigenvalues normalised(const RecordedFrame& frame, Normalisation normalisation) {
  return normalisation == Normalisation::per_inlier ? per_inlier(frame.eigenvalues, frame.inliers)
                                                    : frame.eigenvalues;
}

FineOutcome outcome(const std::vector<RecordedFrame>& frames, const EigenThresholds& thresholds,
                    Normalisation normalisation, int min_directions) {
  FineOutcome result{.frames = frames.size()};
  if (frames.empty()) return result;
  std::size_t rejected = 0;
  std::size_t given_up = 0;
  int directions = 0;
  for (const RecordedFrame& frame : frames) {
    const Eigenvalues e = normalised(frame, normalisation);
    const int above = directions_above(e, thresholds);
    rejected += fine(e, thresholds).accepted() ? 0 : 1;
    given_up += above < min_directions ? 1 : 0;
    directions += above;
  }
  const double n = static_cast<double>(frames.size());
  result.rejected = static_cast<double>(rejected) / n;
  result.rejected_by_remap = static_cast<double>(given_up) / n;
  result.directions = directions / n;
  return result;
}

std::optional<FineCalibration> calibrate_fine(const RecordedFrames& frames,
                                              Normalisation normalisation, double max_false_alarm,
                                              int min_directions) {
  std::vector<Eigenvalues> samples;
  std::vector<double> rotation;
  std::vector<double> position;
  for (const RecordedFrame& frame : frames.healthy) {
    samples.push_back(normalised(frame, normalisation));
    rotation.push_back(samples.back().rotation.minCoeff());
    position.push_back(samples.back().position.minCoeff());
  }
  if (samples.size() < 2) return std::nullopt;
  const auto fit = fit_semicircle(samples);
  if (!fit) return std::nullopt;
  const double share = 0.5 * max_false_alarm;
  FineCalibration result{.normalisation = normalisation,
                         .fit = *fit,
                         .thresholds = {lowered(fit->rotation.lower_edge, rotation, share),
                                        lowered(fit->position.lower_edge, position, share)},
                         .healthy = {},
                         .blind = {},
                         .healthy_at_edge = {},
                         .blind_at_edge = {}};
  const auto tested = [&](const std::vector<RecordedFrame>& of, const EigenThresholds& thresholds) {
    return outcome(of, thresholds, normalisation, min_directions);
  };
  result.healthy = tested(frames.healthy, result.thresholds);
  result.blind = tested(frames.blind, result.thresholds);
  result.healthy_at_edge = tested(frames.healthy, fit->thresholds());
  result.blind_at_edge = tested(frames.blind, fit->thresholds());
  return result;
}

}  // namespace apvi::fusion
