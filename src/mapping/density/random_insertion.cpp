// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/random_insertion.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "gaussians/render/render.hpp"
#include "mapping/density/seeds.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kSolid = 0.5;           // minimum alpha of a valid rendered depth
constexpr double kLogDepthSpread = 0.2;  // standard deviation of an unknown log depth
constexpr double kRadius_px = 1.5;       // of inserted Gaussians
constexpr double kOpacity = 0.1;

/// Samples a depth where the map has none: near the depth of a random surface pixel, or uniformly
/// when the image has none. Uniform samples would mostly lie in open water.
double sample_depth(const Tensor& known, double extent, Random& random) {
  const std::int64_t n = known.numel();
  if (n == 0) return random.uniform(0.1 * extent, extent);
  const auto one =
      std::min(n - 1, static_cast<std::int64_t>(random.uniform() * static_cast<double>(n)));
  return static_cast<double>(known.data_ptr<float>()[one]) *
         std::exp(kLogDepthSpread * random.normal());
}

}  // namespace

gaussians::Gaussians random_gaussians(const Map& map, const KeyframeStore& keyframes,
                                      std::size_t view, std::int64_t count, double extent,
                                      Random& random) {
  const torch::NoGradGuard no_grad;
  const gaussians::View camera = keyframes.view(view, 1);
  const gaussians::Intrinsics& k = camera.intrinsics;
  const gaussians::RenderOutput out = gaussians::render(map.gaussians, camera, {});
  const Tensor depth = out.depth.to(torch::kCPU, torch::kFloat32).contiguous();
  const Tensor alpha = out.alpha.to(torch::kCPU, torch::kFloat32).contiguous();
  const Tensor known = depth.masked_select(alpha > kSolid);
  Seeds seeds = {.pixels = torch::empty({count, 2}, torch::kFloat64),
                 .depths = torch::empty({count}, torch::kFloat64),
                 .radii_px = torch::full({count}, kRadius_px, torch::kFloat64),
                 .opacities = torch::full({count}, kOpacity, torch::kFloat64)};
  auto* const pixels = seeds.pixels.data_ptr<double>();
  for (std::int64_t i = 0; i < count; ++i) {
    const auto u = static_cast<std::int64_t>(random.uniform() * k.width);
    const auto v = static_cast<std::int64_t>(random.uniform() * k.height);
    const std::int64_t pixel = v * k.width + u;
    pixels[2 * i] = static_cast<double>(u) + 0.5;
    pixels[2 * i + 1] = static_cast<double>(v) + 0.5;
    seeds.depths.data_ptr<double>()[i] = alpha.data_ptr<float>()[pixel] > kSolid
                                             ? depth.data_ptr<float>()[pixel]
                                             : sample_depth(known, extent, random);
  }
  return gaussians_from_seeds(seeds, keyframes, view, map.gaussians.sh_degree(), map.medium,
                              camera_response(map, keyframes, view, 1));
}

}  // namespace apvi::mapping
