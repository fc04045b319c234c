// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// What several surveys say together about a water: a sum of information. Each survey is off in its
/// own way, by more than its sightings let it believe, because a young map lies a little wrong and
/// cameras expose by what they see; the mean of some is better than the newest. Earlier surveys
/// count for less with every new one, as water changes and maps get better.
class WaterBelief {
 public:
  /// Takes in what a survey says of the logarithms of beta_d and of beta_b / beta_d: `information`
  /// [3,2,2] float64 and `weighted` [3,2], information times mean, by channel, without what was
  /// believed before it; `logs` [3,2] what it found.
  void add(const torch::Tensor& information, const torch::Tensor& weighted,
           const torch::Tensor& logs);
  /// Takes in what it says of the logarithms of b_inf [3] float64, with their `sigmas` [3], of
  /// pictures with the median gain of all; returns what all surveys say [3]. One that saw open
  /// water counts for more.
  torch::Tensor add_veil(const torch::Tensor& logs, const torch::Tensor& sigmas,
                         bool sees_open_water);
  bool empty() const { return !information_.defined(); }

  /// Of attenuation by channel, sums over the surveys [3,2,2] and [3,2]; only when not `empty`.
  const torch::Tensor& information() const { return information_; }
  const torch::Tensor& weighted() const { return weighted_; }

  void save(torch::serialize::OutputArchive& archive) const;
  /// Throws c10::Error when the archive holds none.
  void load(torch::serialize::InputArchive& archive);

 private:
  void begin();

  torch::Tensor information_;
  torch::Tensor weighted_;
  torch::Tensor veil_;  ///< [2,3]: weights, and weights times logarithms
};

}  // namespace apvi::mapping
