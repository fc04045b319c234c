// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>
#include <cstdint>
#include <optional>

#include "apvi/splat/adam.hpp"
#include "apvi/splat/medium.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::splat {

/// Learns the water of a session beside the map, with a memory and a rate of its own.
class MediumOptimizer {
 public:
  /// `rate` is Adam's, of the parameters free of bounds. Throws c10::Error for water that cannot be
  /// or a rate that is not positive.
  explicit MediumOptimizer(const Medium& start, double rate = 1e-2);

  /// The water as it is believed to be; differentiable down to what `step` changes.
  Medium medium() const;
  /// The leaves behind it.
  const MediumParameters& parameters() const { return parameters_; }

  /// From now on the water stays near `believed`: of every step only what `known` [3,3,3] lets
  /// through is made (by channel, of the logarithms of beta_d, beta_b and b_inf: one lets all
  /// through, zero nothing), a tenth as fast, and each step leans back a little. What no picture
  /// can tell then stays as it is believed to be. A lamp's light is taken over, and not learnt.
  void hold(const Medium& believed, const torch::Tensor& known);

  bool held() const { return believed_.defined(); }

  /// While visual odometry fails, the water has likely changed: then the rate is twice as high (the
  /// paper, section on the medium).
  void set_vio_failing(bool failing) { failing_ = failing; }
  double rate() const;

  /// One step of Adam with the gradients that a backward pass left; takes them away.
  void step(const AdamOptions& options = {});

  /// Everything but the rate, to the bit. `load` throws c10::Error when the archive holds no water.
  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  MediumParameters parameters_;
  std::optional<LampLight> lamp_;
  std::array<torch::Tensor, 3> first_;
  std::array<torch::Tensor, 3> second_;
  torch::Tensor believed_;  ///< [3,3] by channel: raw parameters; undefined while free
  torch::Tensor known_;     ///< [3,3,3] the same, of raw parameters
  std::int64_t steps_ = 0;
  double rate_;
  bool failing_ = false;
};

}  // namespace apvi::splat
