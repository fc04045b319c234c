// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <utility>
#include <vector>

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Reads back losses from a GPU in batches, because every readback synchronizes. On the CPU they
/// are available immediately.
class DeferredLossReadback {
 public:
  /// `loss`: a tensor with one element.
  void add(std::size_t view, const torch::Tensor& loss);
  /// Losses read back since the last call, with their views, in order.
  std::vector<std::pair<std::size_t, double>> take();
  /// The latest loss read back; 0 before the first.
  double newest() const { return newest_; }

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive, const torch::Device& device);

 private:
  void read();

  std::vector<std::pair<std::size_t, torch::Tensor>> pending_;
  std::vector<std::pair<std::size_t, double>> ready_;
  double newest_ = 0.0;
};

}  // namespace apvi::mapping
