// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>
#include <cstdint>
#include <optional>

#include "gaussians/optimizer/adam.hpp"
#include "medium/medium.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::medium {

/// Optimizes the medium parameters together with the map, with separate Adam moments and learning
/// rate.
class MediumOptimizer {
 public:
  /// `rate` is Adam's learning rate of the unconstrained parameters. Throws c10::Error for an
  /// invalid medium or a rate that is not positive.
  explicit MediumOptimizer(const Medium& start, double rate = 1e-2);

  /// The current medium; differentiable down to the raw parameters.
  Medium medium() const;
  /// The raw parameters, leaves of the autograd graph.
  const MediumParameters& parameters() const { return parameters_; }

  /// Resets the parameters to `prior` and keeps them near it from now on. Each step is multiplied
  /// by the matrix `resolution` [3,3,3] (by channel, of the logarithms of beta_d, beta_b and b_inf;
  /// identity: unconstrained, zero: fixed), at a tenth of the learning rate, plus a small pull
  /// toward the prior. Directions that images do not constrain thus keep the prior. The lamp is
  /// copied and not optimized.
  void set_prior(const Medium& prior, const torch::Tensor& resolution);

  bool has_prior() const { return prior_.defined(); }

  /// While visual odometry fails, the water has likely changed, so the learning rate is doubled
  /// (the paper, section on the medium).
  void set_vio_failing(bool failing) { vio_failing_ = failing; }
  double rate() const;

  /// One Adam step with the accumulated gradients, which are cleared.
  void step(const gaussians::AdamOptions& options = {});

  /// Everything but the rate, bit-exact. `load` throws c10::Error when the archive contains no
  /// medium.
  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  MediumParameters parameters_;
  std::optional<LampLight> lamp_;
  std::array<torch::Tensor, 3> first_;
  std::array<torch::Tensor, 3> second_;
  torch::Tensor prior_;       ///< [3,3] raw parameters by channel; undefined: no prior
  torch::Tensor resolution_;  ///< [3,3,3] resolution matrix of the raw parameters
  std::int64_t steps_ = 0;
  double rate_;
  bool vio_failing_ = false;
};

}  // namespace apvi::medium
