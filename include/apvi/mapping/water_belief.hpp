// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// What several surveys say together about the logarithms of beta_d and of beta_b / beta_d of each
/// channel: a sum of information. Each survey is off in its own way, by more than its sightings let
/// it believe, because a young map lies a little wrong and cameras expose by what they see; the
/// mean of some is better than the newest. (How bright water is depends on how bright pictures are
/// taken to be, which is not the same from one survey to the next.)
class WaterBelief {
 public:
  /// Takes in a survey. `information` [3,2,2] float64 and `weighted` [3,2], information times mean,
  /// by channel, without what was believed before it; `logs` [3,2] what it found. Earlier surveys
  /// count for less with every new one, as water changes and maps get better.
  void add(const torch::Tensor& information, const torch::Tensor& weighted,
           const torch::Tensor& logs);
  bool empty() const { return !information_.defined(); }

  /// By channel, sums over the surveys [3,2,2] and [3,2] float64; only when not `empty`.
  const torch::Tensor& information() const { return information_; }
  const torch::Tensor& weighted() const { return weighted_; }

  void save(torch::serialize::OutputArchive& archive) const;
  /// Throws c10::Error when the archive holds none.
  void load(torch::serialize::InputArchive& archive);

 private:
  torch::Tensor information_;
  torch::Tensor weighted_;
};

}  // namespace apvi::mapping
