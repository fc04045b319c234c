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

/// Losses of views that are read from a GPU many at a time: reading one waits for everything that
/// was begun before. On the CPU they are there at once.
class LateLosses {
 public:
  /// A loss: a tensor of one element.
  void add(std::size_t view, const torch::Tensor& loss);
  /// Those that are known by now and were not taken yet, in their order.
  std::vector<std::pair<std::size_t, double>> take();
  /// The newest that is known; 0 before the first.
  double newest() const { return newest_; }

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive, const torch::Device& device);

 private:
  void read();

  std::vector<std::pair<std::size_t, torch::Tensor>> waiting_;
  std::vector<std::pair<std::size_t, double>> known_;
  double newest_ = 0.0;
};

}  // namespace apvi::mapping
