// SPDX-License-Identifier: BSD-3-Clause
#include <torch/torch.h>

#include "survey/crs_points.hpp"
#include "survey/las.hpp"
#include "survey/vertical_renderer.hpp"

namespace apvi::survey {

SurfacePoints surface_points(const SurveyMap& map, const ColorRule& colors) {
  const torch::NoGradGuard no_grad;
  SurfacePoints out;
  out.anchor = map.T_crs_map.translation;
  const GroundBounds bounds = bounds_of(map);
  const torch::Tensor points = crs_points(map, out.anchor);
  const torch::Tensor x = points.select(1, 0) + out.anchor.x();
  const torch::Tensor y = points.select(1, 1) + out.anchor.y();
  const torch::Tensor rows = ((map.map.gaussians.logit_opacities >= 0.0) & (x >= bounds.west) &
                              (x <= bounds.east) & (y >= bounds.south) & (y <= bounds.north))
                                 .nonzero()
                                 .squeeze(1);
  out.positions = points.index_select(0, rows).cpu().contiguous();
  out.colors = colors(light_from_above(map).index_select(0, rows))
                   .to(torch::kCPU, torch::kFloat32)
                   .contiguous();
  return out;
}

}  // namespace apvi::survey
