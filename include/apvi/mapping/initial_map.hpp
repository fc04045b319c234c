// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>

#include "apvi/splat/gaussians.hpp"
#include "apvi/splat/ply.hpp"

namespace apvi::mapping {

struct InitialMapOptions {
  int sh_degree = splat::kMaxShDegree;
  double opacity = 0.1;
  double max_scale_m = 0.5;  ///< of a Gaussian whose neighbours are far
};

/// Round Gaussians at the points, as large as the mean distance to the three nearest neighbours
/// (Kerbl et al., 2023). Throws c10::Error for shapes that do not fit.
splat::Gaussians initial_map(const splat::PointCloud& points, const InitialMapOptions& options);

/// Root mean square distance of every point to its three nearest others [m], [N] float32; 0 for
/// fewer than two points. `points` [N,3] float32 on the CPU.
torch::Tensor neighbour_distance(const torch::Tensor& points);

/// A box in the world [m].
struct Box {
  std::array<double, 3> low{};
  std::array<double, 3> high{};
};
/// Points spread evenly in a box, of medium grey with a little noise; the same for the same seed.
splat::PointCloud random_points(const Box& box, std::int64_t count, std::uint64_t seed);

}  // namespace apvi::mapping
