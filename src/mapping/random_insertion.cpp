// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/random_insertion.hpp"

#include <torch/torch.h>

#include "apvi/mapping/seeds.hpp"
#include "apvi/splat/render.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kSolid = 0.5;     // alpha from which the rendered depth is believed
constexpr double kRadiusPx = 1.5;  // of a new Gaussian
constexpr double kOpacity = 0.1;

}  // namespace

splat::Gaussians random_gaussians(const Map& map, const KeyframeStore& keyframes, std::size_t view,
                                  std::int64_t count, double extent, Random& random) {
  const torch::NoGradGuard no_grad;
  const splat::View camera = keyframes.view(view, 1);
  const splat::Intrinsics& k = camera.intrinsics;
  const splat::RenderOutput out = splat::render(map.gaussians, camera, {});
  const Tensor depth = out.depth.to(torch::kCPU, torch::kFloat32).contiguous();
  const Tensor alpha = out.alpha.to(torch::kCPU, torch::kFloat32).contiguous();
  Seeds seeds = {.pixels = torch::empty({count, 2}, torch::kFloat64),
                 .depths = torch::empty({count}, torch::kFloat64),
                 .radii_px = torch::full({count}, kRadiusPx, torch::kFloat64),
                 .opacities = torch::full({count}, kOpacity, torch::kFloat64)};
  auto* const pixels = seeds.pixels.data_ptr<double>();
  for (std::int64_t i = 0; i < count; ++i) {
    const auto u = static_cast<std::int64_t>(random.uniform() * k.width);
    const auto v = static_cast<std::int64_t>(random.uniform() * k.height);
    const std::int64_t pixel = v * k.width + u;
    const double unknown = random.uniform(0.1 * extent, extent);
    pixels[2 * i] = static_cast<double>(u) + 0.5;
    pixels[2 * i + 1] = static_cast<double>(v) + 0.5;
    seeds.depths.data_ptr<double>()[i] =
        alpha.data_ptr<float>()[pixel] > kSolid ? depth.data_ptr<float>()[pixel] : unknown;
  }
  return gaussians_at(seeds, keyframes, view, map.gaussians.sh_degree(), map.medium,
                      camera_response(map, keyframes, view, 1));
}

}  // namespace apvi::mapping
