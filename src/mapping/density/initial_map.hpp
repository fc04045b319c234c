// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>

#include "gaussians/model/gaussians.hpp"
#include "gaussians/model/point_cloud.hpp"

namespace apvi::mapping {

struct InitialMapOptions {
  int sh_degree = gaussians::kMaxShDegree;
  double opacity = 0.1;
  double max_scale_m = 0.5;  ///< of Gaussians with distant neighbors
};

/// Isotropic Gaussians at the points, scaled by the mean distance to the three nearest neighbors
/// (Kerbl et al., 2023). Throws c10::Error for wrong shapes.
gaussians::Gaussians initial_map(const gaussians::PointCloud& points,
                                 const InitialMapOptions& options);

/// RMS distance of every point to its three nearest neighbors [m], [N] float32; 0 for
/// fewer than two points. `points` [N,3] float32 on the CPU.
torch::Tensor neighbor_distance(const torch::Tensor& points);

/// Axis-aligned box in the world [m].
struct Box {
  std::array<double, 3> low{};
  std::array<double, 3> high{};
};
/// Uniformly distributed gray points in a box; deterministic for a given seed.
gaussians::PointCloud random_points(const Box& box, std::int64_t count, std::uint64_t seed);

}  // namespace apvi::mapping
