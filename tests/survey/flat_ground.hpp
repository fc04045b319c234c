// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/torch.h>

#include <cmath>

#include "gaussians/model/point_cloud.hpp"
#include "survey/survey_map.hpp"

/// Maps whose surface is known in closed form.
namespace apvi::test {

/// An opaque plane z = height + slope x of flat Gaussians on a lattice, from -side/2 to side/2: red
/// where x > 0, blue elsewhere; green where y > 0.
struct Plane {
  double side_m = 2.0;
  double spacing_m = 0.02;
  double height_m = -7.0;
  double slope = 0.0;
};

inline survey::SurveyMap plane_map(const Plane& plane, const SE3& T_crs_map = {}) {
  const auto count = static_cast<std::int64_t>(plane.side_m / plane.spacing_m);
  const torch::Tensor line =
      (torch::arange(count, torch::kFloat64) + 0.5) * plane.spacing_m - 0.5 * plane.side_m;
  const torch::Tensor x = line.repeat_interleave(count);
  const torch::Tensor y = line.repeat({count});
  const std::int64_t n = x.size(0);
  const double tilt = std::atan(plane.slope);
  const double sigma = 0.7 * plane.spacing_m;
  survey::SurveyMap out;
  out.T_crs_map = T_crs_map;
  out.map.gaussians = {
      .means = torch::stack({x, y, plane.height_m + plane.slope * x}, 1).to(torch::kFloat32),
      .log_scales = torch::tensor({sigma, sigma, 1e-4}, torch::kFloat32).log().repeat({n, 1}),
      .quaternions =
          torch::tensor({std::cos(tilt / 2), 0.0, -std::sin(tilt / 2), 0.0}, torch::kFloat32)
              .repeat({n, 1}),
      .logit_opacities = torch::full({n}, 3.0F),
      .sh_dc = gaussians::color_to_sh_dc(torch::stack(
          {(x > 0).to(torch::kFloat32), (y > 0).to(torch::kFloat32), (x <= 0).to(torch::kFloat32)},
          1)),
      .sh_rest = torch::zeros({n, 0, 3})};
  return out;
}

}  // namespace apvi::test
