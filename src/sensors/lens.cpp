// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/lens.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace apvi {
namespace {

struct Lens {
  Distortion distortion;
  std::string_view name;
  std::vector<std::size_t> counts;
};

const std::array<Lens, 5>& lenses() {
  static const std::array<Lens, 5> all = {{{Distortion::none, "none", {0}},
                                           {Distortion::radtan, "radtan", {4, 5, 8}},
                                           {Distortion::equidistant, "equidistant", {4}},
                                           {Distortion::double_sphere, "double_sphere", {2}},
                                           {Distortion::eucm, "eucm", {2}}}};
  return all;
}

const Lens& lens_of(Distortion distortion) {
  return lenses().at(static_cast<std::size_t>(distortion));
}

bool takes(const Lens& lens, std::size_t count) {
  return std::find(lens.counts.begin(), lens.counts.end(), count) != lens.counts.end();
}

Distortion inferred(std::size_t count) {
  std::vector<const Lens*> fitting;
  for (const Lens& lens : lenses()) {
    if (takes(lens, count)) fitting.push_back(&lens);
  }
  if (fitting.size() == 1) return fitting.front()->distortion;
  if (fitting.empty()) {
    throw std::invalid_argument(fmt::format(
        "no lens model takes {} coefficients; radtan takes 4, 5 or 8, equidistant 4, double_sphere "
        "and eucm 2",
        count));
  }
  throw std::invalid_argument(
      fmt::format("{} coefficients fit {} and {}: say which with the key distortion", count,
                  fitting.front()->name, fitting.back()->name));
}

}  // namespace

std::string_view lens_name(Distortion distortion) {
  return lens_of(distortion).name;
}

const std::vector<std::size_t>& coefficient_counts(Distortion distortion) {
  return lens_of(distortion).counts;
}

std::vector<double> coefficients_of(const CameraModel::Parameters& camera) {
  const auto& k = camera.coefficients;
  const auto zero_from = [&](std::size_t count) {
    return std::all_of(k.begin() + static_cast<std::ptrdiff_t>(count), k.end(),
                       [](double value) { return value == 0.0; });
  };
  const auto& counts = coefficient_counts(camera.distortion);
  const auto count = std::find_if(counts.begin(), counts.end() - 1, zero_from);
  return {k.begin(), k.begin() + static_cast<std::ptrdiff_t>(*count)};
}

Eigen::Vector2d focal_lengths(const CameraModel::Parameters& camera) {
  const bool sphere = camera.distortion == Distortion::double_sphere;
  return Eigen::Vector2d(camera.fx, camera.fy) / (sphere ? 1.0 + camera.coefficients[0] : 1.0);
}

std::optional<std::string> lens_problem(const CameraModel::Parameters& camera) {
  const auto& k = camera.coefficients;
  if (!std::all_of(k.begin(), k.end(), [](double value) { return std::isfinite(value); })) {
    return "coefficients must be finite";
  }
  const auto is_share = [](double alpha) { return alpha >= 0.0 && alpha <= 1.0; };
  if (camera.distortion == Distortion::double_sphere && !(std::abs(k[0]) < 1.0 && is_share(k[1]))) {
    return "double_sphere takes xi between -1 and 1 and alpha from 0 to 1, in this order";
  }
  if (camera.distortion == Distortion::eucm && !(is_share(k[0]) && k[1] > 0.0)) {
    return "eucm takes alpha from 0 to 1 and a positive beta, in this order";
  }
  return std::nullopt;
}

void set_lens(std::optional<Distortion> distortion, const std::vector<double>& coefficients,
              CameraModel::Parameters& camera) {
  const std::size_t count = coefficients.size();
  camera.distortion = distortion ? *distortion : inferred(count);
  camera.coefficients = {};
  const bool zeros = std::all_of(coefficients.begin(), coefficients.end(),
                                 [](double value) { return value == 0.0; });
  if (camera.distortion == Distortion::none && zeros) return;
  const Lens& lens = lens_of(camera.distortion);
  if (!takes(lens, count)) {
    throw std::invalid_argument(fmt::format("{} takes {} coefficients, got {}", lens.name,
                                            fmt::join(lens.counts, " or "), count));
  }
  std::copy(coefficients.begin(), coefficients.end(), camera.coefficients.begin());
  if (const auto problem = lens_problem(camera)) throw std::invalid_argument(*problem);
}

}  // namespace apvi
