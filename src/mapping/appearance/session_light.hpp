// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Color of the light on the surfaces of a session relative to the session that the colors of a
/// common map are for: sun or lamp, white balance and exposure of its camera. Optimized with the
/// map, as logarithms, with Adam.
class SessionLight {
 public:
  /// `start` [3], positive.
  SessionLight(const torch::Tensor& start, const torch::Device& device);

  /// [3]; recorded by autograd for `step` with `learn`.
  torch::Tensor color(bool learn) const;
  /// One step with the gradient of the last `color(true)`.
  void step();

  void save(torch::serialize::OutputArchive& archive) const;
  /// Throws c10::Error when the archive has no light.
  void load(torch::serialize::InputArchive& archive);

 private:
  torch::Tensor logs_, first_, second_;
  std::int64_t steps_ = 0;
};

}  // namespace apvi::mapping
