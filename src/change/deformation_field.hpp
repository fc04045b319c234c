// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>

namespace apvi::change {

/// Normal equations H u = g of the displacement u of each of n points: [n,3,3] and [n,3].
struct PointEquations {
  torch::Tensor H, g;
};

/// A smooth field of displacements: trilinear between the nodes of a regular grid.
class DeformationField {
 public:
  DeformationField() = default;  ///< no displacement anywhere
  /// Nodes at `spacing_m` around the points [n,3], or farther apart if that were more than 20 000.
  DeformationField(const torch::Tensor& points, double spacing_m);

  bool empty() const { return !nodes_.defined(); }
  torch::Device device() const { return nodes_.device(); }
  /// Displacements [n,3] at points [n,3]; beyond the grid those of its edge [m].
  torch::Tensor operator()(const torch::Tensor& points) const;
  /// Adds the least-squares displacement to the nodes: of the equations at `points`, and of
  /// differences between neighboring nodes with standard deviation `step_sigma_m`.
  void update(const torch::Tensor& points, const PointEquations& equations, double step_sigma_m);

 private:
  /// The eight nodes around each point and their weights.
  struct Corners {
    std::array<torch::Tensor, 8> nodes;    ///< [n] int64
    std::array<torch::Tensor, 8> weights;  ///< [n]
  };
  Corners corners(const torch::Tensor& points) const;
  std::int64_t count() const { return size_[0] * size_[1] * size_[2]; }

  std::array<std::int64_t, 3> size_{};
  double spacing_m_ = 0.0;
  torch::Tensor low_;    ///< [3] position of the first node
  torch::Tensor nodes_;  ///< [count,3] float32 [m]
};

}  // namespace apvi::change
