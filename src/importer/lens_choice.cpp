// SPDX-License-Identifier: BSD-3-Clause
#include "importer/lens_choice.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

namespace apvi::importer {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr std::size_t kMinSegments = 4;
// Quantiles of 99.5 % of Student's t distribution, for 3, 4 ... degrees of freedom.
constexpr std::array kMinT{5.84, 4.60, 4.03, 3.71, 3.50, 3.36, 3.25};
constexpr std::array kShapes{
    LensShape{Lens::rectilinear, false}, LensShape{Lens::equidistant, false},
    LensShape{Lens::rectilinear, true}, LensShape{Lens::equidistant, true}};
// Horizontal angles in air from which adjustments start, and the span that a lens may have [deg].
constexpr std::array kStarts{60.0, 90.0, 120.0};
constexpr double kNarrowest = 20.0;
constexpr double kWidest = 150.0;
constexpr double kNoise_px = 0.1;  // of a corner; errors below are equally good

struct Candidate {
  LensShape shape;
  LensFit fit;
};

double focal_of(Lens lens, double half_px, double degrees) {
  const double half = 0.5 * degrees * kDegree;
  return half_px / (lens == Lens::rectilinear ? std::tan(half) : half);
}

double degrees_of(Lens lens, double half_px, double focal_px) {
  const double half = half_px / focal_px;
  return 2.0 * (lens == Lens::rectilinear ? std::atan(half) : half) / kDegree;
}

Candidate assumed_candidate(const FieldOfView& view, ImageSize size, bool under_water,
                            const std::vector<TrackSegment>& segments) {
  const double half_px = 0.5 * (view.diagonal ? std::hypot(size.width, size.height) : size.width);
  const LensShape shape{view.lens, view.in_air && under_water};
  const double focal = focal_of(view.lens, half_px, view.degrees);
  return {shape, fit_lens(shape, focal, false, size, segments)};
}

bool plausible(const Candidate& candidate, ImageSize size) {
  const double degrees = degrees_of(candidate.shape.lens, 0.5 * size.width, candidate.fit.focal_px);
  return degrees > kNarrowest && degrees < kWidest && std::isfinite(candidate.fit.total);
}

// From several angles of view, and once more from the best: with its focal length the motions
// between images may be right where those of the start were not.
std::optional<Candidate> best_of(const LensShape& shape, ImageSize size,
                                 const std::vector<TrackSegment>& segments) {
  std::optional<Candidate> best;
  const auto attempt = [&](double focal) {
    const Candidate candidate{shape, fit_lens(shape, focal, true, size, segments)};
    const bool better = !best || candidate.fit.total < best->fit.total;
    if (better && plausible(candidate, size)) best = candidate;
  };
  for (const double degrees : kStarts) attempt(focal_of(shape.lens, 0.5 * size.width, degrees));
  if (best) attempt(best->fit.focal_px);
  return best;
}

/// The best lens of each shape, from the best one on.
std::vector<Candidate> candidates(ImageSize size, bool under_water,
                                  const std::vector<TrackSegment>& segments) {
  std::vector<Candidate> found;
  for (const LensShape& shape : kShapes) {
    if (shape.port && !under_water) continue;
    if (auto best = best_of(shape, size, segments)) found.push_back(std::move(*best));
  }
  std::ranges::sort(found, {}, [](const Candidate& c) { return c.fit.total; });
  return found;
}

// Student's t of the logarithms by which the second fit is better in the segments.
struct Comparison {
  std::size_t segments = 0;
  double t = 0.0;

  bool is_clear() const {
    if (segments < kMinSegments) return false;
    return t > kMinT[std::min(segments - kMinSegments, kMinT.size() - 1)];
  }
};

Comparison compare(const LensFit& assumed, const LensFit& other) {
  std::vector<double> gains;
  for (std::size_t s = 0; s < assumed.cost.size(); ++s) {
    if (std::isnan(assumed.cost[s]) || std::isnan(other.cost[s])) continue;
    const auto error = [](double cost) { return std::log(cost + kNoise_px * kNoise_px); };
    gains.push_back(error(assumed.cost[s]) - error(other.cost[s]));
  }
  const auto count = static_cast<double>(gains.size());
  if (gains.size() < 2) return {gains.size(), 0.0};
  double mean = 0.0;
  for (const double gain : gains) mean += gain / count;
  double variance = 0.0;
  for (const double gain : gains) variance += (gain - mean) * (gain - mean) / (count - 1.0);
  return {gains.size(), mean / std::sqrt(variance / count + 1e-12)};
}

std::string name_of(const LensShape& shape) {
  return fmt::format("{}{}", shape.lens == Lens::rectilinear ? "rectilinear" : "equidistant",
                     shape.port ? " behind a flat port" : "");
}

double rms(const LensFit& fit) {
  return std::sqrt(fit.total);
}

FieldOfView view_of(const Candidate& candidate, ImageSize size) {
  return {.degrees = degrees_of(candidate.shape.lens, 0.5 * size.width, candidate.fit.focal_px),
          .lens = candidate.shape.lens,
          .in_air = candidate.shape.port,
          .origin = "corners followed through the images"};
}

std::string figures_of(const std::vector<Candidate>& found, const Candidate& assumed,
                       const Comparison& comparison) {
  std::string text = fmt::format("reprojection error {:.2f} px, assumed lens {:.2f} px",
                                 rms(found.front().fit), rms(assumed.fit));
  if (found.size() > 1) {
    text += fmt::format(", {} {:.2f} px", name_of(found[1].shape), rms(found[1].fit));
  }
  return text + fmt::format("; t = {:.1f} in {} parts", comparison.t, comparison.segments);
}

}  // namespace

LensChoice choose_lens(const FieldOfView& assumed, ImageSize size, bool under_water,
                       const std::vector<TrackSegment>& segments) {
  if (segments.size() < kMinSegments) {
    return {assumed, fmt::format("too few parts of the images have corners that move ({} of {})",
                                 segments.size(), kMinSegments)};
  }
  const Candidate before = assumed_candidate(assumed, size, under_water, segments);
  const std::vector<Candidate> found = candidates(size, under_water, segments);
  if (found.empty()) return {assumed, "no lens explains how corners move"};
  const Candidate& best = found.front();
  const Comparison comparison = compare(before.fit, best.fit);
  const std::string reason = name_of(best.shape) + ": " + figures_of(found, before, comparison);
  if (comparison.is_clear()) return {view_of(best, size), reason};
  return {assumed, "the images do not tell a better lens: " + reason};
}

}  // namespace apvi::importer
