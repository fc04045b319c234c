// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/rendering.hpp"

#include <torch/torch.h>

#include "apvi/splat/render.hpp"

namespace apvi::mapping {

Picture take_picture(const Map& map, const splat::View& view) {
  const torch::NoGradGuard no_grad;
  const splat::RenderOutput out =
      splat::render(map.gaussians, view, {.antialiased = map.antialiased, .background = {}});
  Picture picture = {
      .as_seen = out.color, .restored = out.color, .depth = out.depth, .alpha = out.alpha};
  if (!map.medium) return picture;
  const auto like = [&out](const torch::Tensor& values) { return values.to(out.color.options()); };
  picture.as_seen =
      splat::apply_medium(out.color, splat::depth_to_range(out.depth, view.intrinsics), out.alpha,
                          {.beta_d = like(map.medium->beta_d),
                           .beta_b = like(map.medium->beta_b),
                           .b_inf = like(map.medium->b_inf)});
  return picture;
}

}  // namespace apvi::mapping
