// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/blocks/block_partition.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <utility>

namespace apvi::mapping {
namespace {

using torch::Tensor;
using Split = BlockPartition::Split;

/// Splits points recursively and numbers the blocks from one side to the other.
class Splitter {
 public:
  std::vector<Split> take() && { return std::move(splits_); }

  /// Splits into `blocks` parts; returns the index for Split::below.
  int add(const Tensor& points, int blocks) {
    if (blocks > 1 && points.size(0) > 1) {
      const Tensor xy = points.slice(1, 0, 2);
      const Tensor sides = std::get<0>(xy.max(0)) - std::get<0>(xy.min(0));
      const int axis = sides[0].item<double>() >= sides[1].item<double>() ? 0 : 1;
      if (sides[axis].item<double>() > 0.0) return add_split(points, blocks, axis);
    }
    return -1 - blocks_++;
  }

 private:
  int add_split(const Tensor& points, int blocks, int axis) {
    const int below = blocks / 2;
    const Tensor along = points.select(1, axis);
    const Tensor sorted = std::get<0>(along.sort());
    const std::int64_t rank = std::max<std::int64_t>(1, points.size(0) * below / blocks);
    double value = 0.5 * (sorted[rank - 1].item<double>() + sorted[rank].item<double>());
    // Equal coordinates stay together; both sides get points.
    if (!(value > sorted[0].item<double>())) value = sorted[along.size(0) - 1].item<double>();
    const auto index = static_cast<int>(splits_.size());
    splits_.push_back({.axis = axis, .value = value});
    const Tensor is_below = along < value;
    const auto part = [&](const Tensor& which) {
      return points.index_select(0, which.nonzero().squeeze(1));
    };
    const int first = add(part(is_below), below);
    const int second = add(part(is_below.logical_not()), blocks - below);
    splits_[static_cast<std::size_t>(index)].below = first;
    splits_[static_cast<std::size_t>(index)].above = second;
    return index;
  }

  std::vector<Split> splits_;
  int blocks_ = 0;
};

void check(const std::vector<Split>& splits) {
  std::vector<int> children;
  for (const Split& split : splits) {
    TORCH_CHECK(split.axis == 0 || split.axis == 1, "partition: bad axis ", split.axis);
    children.insert(children.end(), {split.below, split.above});
  }
  std::sort(children.begin(), children.end());
  // Every block and every split but the root is a child once.
  const auto count = static_cast<int>(splits.size());
  std::vector<int> expected;
  for (int i = -1 - count; i < count; ++i) {
    if (i != 0) expected.push_back(i);
  }
  TORCH_CHECK(splits.empty() || children == expected, "partition: the splits are not a tree");
}

}  // namespace

BlockPartition::BlockPartition(std::vector<Split> splits) : splits_(std::move(splits)) {
  check(splits_);
}

BlockPartition BlockPartition::of(const Tensor& points, int blocks) {
  Splitter splitter;
  splitter.add(points, blocks);
  return BlockPartition(std::move(splitter).take());
}

Tensor BlockPartition::block_of(const Tensor& positions) const {
  const Tensor xy = positions.slice(1, 0, 2).to(torch::kFloat64);
  Tensor at = torch::full({positions.size(0)}, splits_.empty() ? -1 : 0,
                          torch::dtype(torch::kInt64).device(positions.device()));
  // A split's children come after it.
  for (std::size_t i = 0; i < splits_.size(); ++i) {
    const Split& split = splits_[i];
    const Tensor child =
        torch::where(xy.select(1, split.axis) < split.value, static_cast<std::int64_t>(split.below),
                     static_cast<std::int64_t>(split.above));
    at = torch::where(at == static_cast<std::int64_t>(i), child, at);
  }
  return -1 - at;
}

}  // namespace apvi::mapping
