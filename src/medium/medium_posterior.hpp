// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::medium {

/// Posterior of the medium parameters, accumulated over several estimations as a sum of
/// information. Each estimation is biased by more than its own covariance, because an early map has
/// geometric errors and auto-exposure depends on the scene, so an average over several estimations
/// is more accurate than the latest one. Earlier estimations decay, because the water and the map
/// change.
class MediumPosterior {
 public:
  /// Adds one estimation of log(beta_d) and log(beta_b / beta_d), without its prior: `information`
  /// [3,2,2] float64 by channel, `information_mean` [3,2] = information times mean, and the
  /// estimate itself, `logs` [3,2].
  void add(const torch::Tensor& information, const torch::Tensor& information_mean,
           const torch::Tensor& logs);
  /// Adds one estimation of log(b_inf) [3] float64 with its standard deviations `sigmas` [3], at
  /// the median gain of all images. Estimations that observed open water get a higher weight.
  /// Returns the fused log(b_inf) [3].
  torch::Tensor add_veiling_light(const torch::Tensor& logs, const torch::Tensor& sigmas,
                                  bool sees_open_water);
  bool empty() const { return !information_.defined(); }

  /// Accumulated over the estimations, by channel: [3,2,2] and [3,2]. Only when not `empty`.
  const torch::Tensor& information() const { return information_; }
  const torch::Tensor& information_mean() const { return information_mean_; }

  void save(torch::serialize::OutputArchive& archive) const;
  /// Throws c10::Error when the archive does not contain a valid posterior.
  void load(torch::serialize::InputArchive& archive);

 private:
  void initialize();

  torch::Tensor information_;
  torch::Tensor information_mean_;
  torch::Tensor veiling_light_;  ///< [2,3] weights, and weights times log(b_inf)
};

}  // namespace apvi::medium
