// SPDX-License-Identifier: BSD-3-Clause
#include "survey/survey_map.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <utility>

#include "apvi/core/error.hpp"
#include "survey/crs_points.hpp"

namespace apvi::survey {
namespace {

using torch::Tensor;

constexpr double kTail = 0.005;
constexpr double kMargin = 0.1;

/// First and last of sorted values [n], outliers cut.
std::pair<double, double> range_of(const Tensor& sorted) {
  const double* const v = sorted.data_ptr<double>();
  const auto last = static_cast<double>(sorted.size(0) - 1);
  const double low = v[static_cast<std::int64_t>(kTail * last)];
  const double high = v[static_cast<std::int64_t>((1.0 - kTail) * last + 0.5)];
  const double margin = kMargin * (high - low);
  return {std::max(v[0], low - margin), std::min(v[sorted.size(0) - 1], high + margin)};
}

}  // namespace

GroundBounds bounds_of(const SurveyMap& map) {
  const torch::NoGradGuard no_grad;
  const Eigen::Vector3d anchor = map.T_crs_map.translation;
  const Tensor solid = (map.map.gaussians.logit_opacities >= 0.0).nonzero().squeeze(1);
  if (solid.size(0) == 0) {
    fail_input("the map shows no surface from above: no opaque Gaussian that keyframes saw");
  }
  const Tensor points = crs_points(map, anchor).index_select(0, solid).cpu();
  const auto sorted = [&](std::int64_t axis) {
    return std::get<0>(points.select(1, axis).sort()).contiguous();
  };
  const auto [west, east] = range_of(sorted(0));
  const auto [south, north] = range_of(sorted(1));
  return {west + anchor.x(), south + anchor.y(), east + anchor.x(), north + anchor.y()};
}

}  // namespace apvi::survey
