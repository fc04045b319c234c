// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

namespace apvi::change {

/// Quantiles over the surroundings of points: of cubes of `block_m` and their neighbors, three of
/// them wide. What is true of most of a neighborhood is noise there; what changed is the rest.
class Neighborhoods {
 public:
  Neighborhoods(const torch::Tensor& points, double block_m);

  /// For each point the quantile `part` of the columns of `values` [n,k] in its neighborhood.
  torch::Tensor quantiles(const torch::Tensor& values, double part) const;

 private:
  torch::Tensor block_;                ///< [n] which block
  std::vector<torch::Tensor> around_;  ///< by block: rows of the points in the neighborhood
};

/// Standard deviations [n,k] of values [n,k] of as much support [n] (number of views), in groups of
/// about equal size: by what nine tenths of a group are within, so that up to a tenth may have
/// changed. They do not grow with support.
torch::Tensor deviations_by_support(const torch::Tensor& values, const torch::Tensor& support);

}  // namespace apvi::change
