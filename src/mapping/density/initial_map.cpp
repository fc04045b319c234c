// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/initial_map.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/random.hpp"
#include "mapping/density/kd_tree.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::size_t kNeighbors = 3;
constexpr double kMinScale_m = 1e-4;  // of coincident points

}  // namespace

Tensor neighbor_distance(const Tensor& points) {
  const Tensor positions = points.contiguous();
  const std::int64_t n = positions.size(0);
  const KdTree tree(positions.data_ptr<float>(), n);
  Tensor distance = torch::zeros({n});
  for (std::int64_t i = 0; i < n; ++i) {
    const auto squared = tree.nearest(i, kNeighbors);
    if (squared.empty()) continue;
    const float sum = std::accumulate(squared.begin(), squared.end(), 0.0F);
    distance.data_ptr<float>()[i] = std::sqrt(sum / static_cast<float>(squared.size()));
  }
  return distance;
}

gaussians::Gaussians initial_map(const gaussians::PointCloud& points,
                                 const InitialMapOptions& options) {
  const std::int64_t n = points.positions.size(0);
  TORCH_CHECK(points.positions.sizes() == at::IntArrayRef({n, 3}) &&
                  points.colors.sizes() == at::IntArrayRef({n, 3}),
              "initial map: positions have shape ", points.positions.sizes(), ", colors ",
              points.colors.sizes());
  const Tensor scales = neighbor_distance(points.positions).clamp(kMinScale_m, options.max_scale_m);
  const double logit = std::log(options.opacity / (1.0 - options.opacity));
  Tensor quaternions = torch::zeros({n, 4});
  quaternions.select(1, 0).fill_(1.0);
  return {.means = points.positions.clone(),
          .log_scales = scales.log().unsqueeze(1).repeat({1, 3}),
          .quaternions = quaternions,
          .logit_opacities = torch::full({n}, logit, torch::kFloat32),
          .sh_dc = gaussians::color_to_sh_dc(points.colors),
          .sh_rest = torch::zeros({n, gaussians::sh_rest_count(options.sh_degree), 3})};
}

gaussians::PointCloud random_points(const Box& box, std::int64_t count, std::uint64_t seed) {
  Random random(seed);
  gaussians::PointCloud points = {.positions = torch::empty({count, 3}),
                                  .colors = torch::empty({count, 3})};
  auto* const position = points.positions.data_ptr<float>();
  auto* const color = points.colors.data_ptr<float>();
  for (std::int64_t i = 0; i < count; ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::int64_t at = 3 * i + static_cast<std::int64_t>(axis);
      position[at] = static_cast<float>(random.uniform(box.low[axis], box.high[axis]));
      color[at] = static_cast<float>(random.uniform(0.4, 0.6));
    }
  }
  return points;
}

}  // namespace apvi::mapping
