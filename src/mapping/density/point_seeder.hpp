// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <map>

#include "apvi/mapping/options.hpp"
#include "gaussians/model/similarity.hpp"
#include "gaussians/render/view.hpp"
#include "mapping/density/seeds.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Sparse world points; all tensors have the same length n.
struct SparsePoints {
  torch::Tensor ids;        ///< [n] int64, never reused for another point
  torch::Tensor positions;  ///< [n,3] float64 [m]
  torch::Tensor sigmas;     ///< [n] float64 standard deviation along the ray [m]
};

/// Seeds at the sparse points and range samples that come with a keyframe; each point once.
class PointSeeder {
 public:
  explicit PointSeeder(const OnlineOptions& options);

  /// Seeds of new, visible and accurate points, and of all visible range `samples` [m,3] float64
  /// [m], which may be undefined. Both are in the map frame.
  Seeds seeds(const gaussians::View& camera, const SparsePoints& points,
              const torch::Tensor& samples);
  void change_scale(const gaussians::ScaleChange& change);
  /// Positions [n,3] float64 of the newest seeds [m].
  const torch::Tensor& positions() const { return positions_; }

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  torch::Tensor new_points(const gaussians::View& camera, const SparsePoints& points);

  double max_relative_sigma_;
  double opacity_;
  torch::Tensor positions_;
  std::map<std::int64_t, bool> seeded_;  ///< by id, of the last points: whether seeded
};

}  // namespace apvi::mapping
