// SPDX-License-Identifier: BSD-3-Clause
#include "change/deformation_field.hpp"

#include <torch/torch.h>

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <cmath>
#include <vector>

namespace apvi::change {
namespace {

using torch::Tensor;
using Triplets = std::vector<Eigen::Triplet<double>>;

constexpr std::int64_t kMaxNodes = 20000;
constexpr double kFarSigma = 10.0;  // [m] of nodes that nothing constrains

/// Adds a 3x3 block at nodes (a, b).
void add_block(Triplets& out, std::int64_t a, std::int64_t b, const double* block) {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      out.emplace_back(static_cast<int>(3 * a + i), static_cast<int>(3 * b + j), block[3 * i + j]);
    }
  }
}

/// Sums of H over points, weighted, for pairs of nodes.
void add_pairs(Triplets& out, const Tensor& pairs, const Tensor& blocks, std::int64_t count) {
  const auto [keys, inverse, counts] = torch::_unique2(pairs, true, true);
  const Tensor sums = torch::zeros({keys.size(0), 9}, torch::kFloat64)
                          .index_add_(0, inverse, blocks.view({-1, 9}))
                          .contiguous();
  const Tensor flat = keys.contiguous();
  for (std::int64_t i = 0; i < flat.size(0); ++i) {
    const std::int64_t key = flat.data_ptr<std::int64_t>()[i];
    add_block(out, key / count, key % count, sums.data_ptr<double>() + 9 * i);
  }
}

/// Information of differences between neighbors along the three axes, and of all nodes, weakly.
void add_smoothness(Triplets& out, const std::array<std::int64_t, 3>& size, double information) {
  const std::array<std::int64_t, 3> stride = {size[1] * size[2], size[2], 1};
  const std::int64_t count = size[0] * size[1] * size[2];
  for (std::int64_t node = 0; node < count; ++node) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (node / stride[axis] % size[axis] + 1 == size[axis]) continue;
      const std::int64_t other = node + stride[axis];
      for (int i = 0; i < 3; ++i) {
        const int a = static_cast<int>(3 * node + i);
        const int b = static_cast<int>(3 * other + i);
        out.emplace_back(a, a, information);
        out.emplace_back(b, b, information);
        out.emplace_back(a, b, -information);
        out.emplace_back(b, a, -information);
      }
    }
    for (int i = 0; i < 3; ++i) {
      const int a = static_cast<int>(3 * node + i);
      out.emplace_back(a, a, 1.0 / (kFarSigma * kFarSigma));
    }
  }
}

Tensor solved(const Triplets& triplets, const Tensor& right) {
  const auto n = right.numel();
  Eigen::SparseMatrix<double> A(n, n);
  A.setFromTriplets(triplets.begin(), triplets.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(A);
  const Eigen::Map<const Eigen::VectorXd> b(right.data_ptr<double>(), n);
  const Eigen::VectorXd x = solver.solve(b);
  Tensor out = torch::empty_like(right);
  Eigen::Map<Eigen::VectorXd>(out.data_ptr<double>(), n) = x;
  return out;
}

}  // namespace

DeformationField::DeformationField(const Tensor& points, double spacing_m) : spacing_m_(spacing_m) {
  low_ = std::get<0>(points.min(0)) - 0.5 * spacing_m;
  const Tensor extent = (std::get<0>(points.max(0)) - low_).to(torch::kCPU, torch::kFloat64);
  do {
    for (std::int64_t i = 0; i < 3; ++i) {
      size_[static_cast<std::size_t>(i)] =
          2 + static_cast<std::int64_t>(extent[i].item<double>() / spacing_m_);
    }
    if (count() > kMaxNodes) spacing_m_ *= 1.5;
  } while (count() > kMaxNodes);
  nodes_ = torch::zeros({count(), 3}, points.options());
}

DeformationField::Corners DeformationField::corners(const Tensor& points) const {
  std::array<Tensor, 3> base;
  std::array<Tensor, 3> part;
  for (std::int64_t i = 0; i < 3; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const auto last = static_cast<double>(size_[k] - 1);
    const Tensor x = ((points.select(1, i) - low_[i]) / spacing_m_).clamp(0.0, last);
    base[k] = x.floor().clamp_max(last - 1.0);
    part[k] = x - base[k];
  }
  Corners out;
  for (std::size_t c = 0; c < 8; ++c) {
    const std::array<std::int64_t, 3> up = {static_cast<std::int64_t>(c >> 2U & 1U),
                                            static_cast<std::int64_t>(c >> 1U & 1U),
                                            static_cast<std::int64_t>(c & 1U)};
    Tensor node = torch::zeros_like(base[0]).to(torch::kInt64);
    Tensor weight = torch::ones_like(base[0]);
    for (std::size_t k = 0; k < 3; ++k) {
      node = node * size_[k] + base[k].to(torch::kInt64) + up[k];
      weight = weight * (up[k] == 1 ? part[k] : 1.0 - part[k]);
    }
    out.nodes[c] = node;
    out.weights[c] = weight;
  }
  return out;
}

Tensor DeformationField::operator()(const Tensor& points) const {
  Tensor out = torch::zeros_like(points);
  if (empty()) return out;
  const Corners at = corners(points);
  for (std::size_t c = 0; c < 8; ++c) {
    out += at.weights[c].unsqueeze(1) * nodes_.index_select(0, at.nodes[c]);
  }
  return out;
}

void DeformationField::update(const Tensor& points, const PointEquations& equations,
                              double step_sigma_m) {
  const Corners at = corners(points);
  const auto host = [](const Tensor& t) { return t.to(torch::kCPU, torch::kFloat64); };
  const Tensor H = host(equations.H);
  const Tensor g = host(equations.g);
  Triplets triplets;
  Tensor right = torch::zeros({count(), 3}, torch::kFloat64);
  for (std::size_t a = 0; a < 8; ++a) {
    const Tensor node = at.nodes[a].to(torch::kCPU);
    const Tensor weight = host(at.weights[a]);
    right.index_add_(0, node, weight.unsqueeze(1) * g);
    for (std::size_t b = 0; b < 8; ++b) {
      const Tensor product = weight * host(at.weights[b]);
      add_pairs(triplets, node * count() + at.nodes[b].to(torch::kCPU),
                product.view({-1, 1, 1}) * H, count());
    }
  }
  const double information = 1.0 / (step_sigma_m * step_sigma_m);
  add_smoothness(triplets, size_, information);
  // The smoothness is that of the sum of all updates.
  const Tensor before = host(nodes_);
  Triplets prior;
  add_smoothness(prior, size_, information);
  for (const auto& entry : prior) {
    const std::int64_t row = entry.row();
    const std::int64_t column = entry.col();
    right.data_ptr<double>()[row] -= entry.value() * before.contiguous().data_ptr<double>()[column];
  }
  nodes_ = nodes_ + solved(triplets, right.contiguous()).view({-1, 3}).to(nodes_.options());
}

}  // namespace apvi::change
