// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/random_insertion.hpp"

#include <torch/torch.h>

#include <cmath>

#include "apvi/splat/ply.hpp"
#include "apvi/splat/render.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kSolid = 0.5;     // alpha from which the rendered depth is believed
constexpr double kRadiusPx = 1.5;  // of a new Gaussian
constexpr double kOpacity = 0.1;

}  // namespace

splat::Gaussians random_gaussians(const splat::Gaussians& map, const KeyframeStore& keyframes,
                                  std::size_t view, std::int64_t count, double extent,
                                  Random& random) {
  const torch::NoGradGuard no_grad;
  const splat::View camera = keyframes.view(view, 1);
  const splat::Intrinsics& k = camera.intrinsics;
  const splat::RenderOutput out = splat::render(map, camera, {});
  const Tensor depth = out.depth.to(torch::kCPU, torch::kFloat32).contiguous();
  const Tensor alpha = out.alpha.to(torch::kCPU, torch::kFloat32).contiguous();
  const Tensor image = keyframes.image(view, 1, torch::kCPU).reshape({-1, 3});
  Tensor points = torch::ones({count, 4}, torch::kFloat64);
  Tensor pixels = torch::empty({count}, torch::kInt64);
  for (std::int64_t i = 0; i < count; ++i) {
    const auto u = static_cast<std::int64_t>(random.uniform() * k.width);
    const auto v = static_cast<std::int64_t>(random.uniform() * k.height);
    const std::int64_t pixel = v * k.width + u;
    const double unknown = random.uniform(0.1 * extent, extent);
    const double z =
        alpha.data_ptr<float>()[pixel] > kSolid ? depth.data_ptr<float>()[pixel] : unknown;
    auto* const point = points.data_ptr<double>() + 4 * i;
    point[0] = (static_cast<double>(u) + 0.5 - k.cx) / k.fx * z;
    point[1] = (static_cast<double>(v) + 0.5 - k.cy) / k.fy * z;
    point[2] = z;
    pixels.data_ptr<std::int64_t>()[i] = pixel;
  }
  const Tensor scales = (points.select(1, 2) * (kRadiusPx / k.fx)).log();
  const Tensor world = points.mm(torch::inverse(camera.T_camera_world).t()).slice(1, 0, 3);
  const auto options = map.means.options();
  Tensor quaternions = torch::zeros({count, 4}, options);
  quaternions.select(1, 0).fill_(1.0);
  return {.means = world.to(options),
          .log_scales = scales.unsqueeze(1).repeat({1, 3}).to(options),
          .quaternions = quaternions,
          .logit_opacities = torch::full({count}, std::log(kOpacity / (1.0 - kOpacity)), options),
          .sh_dc = splat::color_to_sh_dc(image.index_select(0, pixels)).to(options),
          .sh_rest = torch::zeros({count, map.sh_rest.size(1), 3}, options)};
}

}  // namespace apvi::mapping
