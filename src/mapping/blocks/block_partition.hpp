// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

namespace apvi::mapping {

/// Blocks of a large map: the plane is split by vertical planes, again and again, into parts with
/// equal amounts of surface (a k-d tree). The outer blocks are unbounded, so that every position is
/// in exactly one.
class BlockPartition {
 public:
  /// A plane: positions with a coordinate `axis` (0: x, 1: y) below `value` are in `below`. These
  /// are indices of splits, or of blocks as -1 - block.
  struct Split {
    int axis = 0;
    double value = 0.0;
    int below = -1;
    int above = -1;
    bool operator==(const Split&) const = default;
  };

  /// One block.
  BlockPartition() = default;
  /// From `splits()`. Throws c10::Error when they are not a tree.
  explicit BlockPartition(std::vector<Split> splits);
  /// Splits `points` [n,3] float64 on the CPU into `blocks` parts with equal numbers of points,
  /// each along its longer side. Fewer when there are not enough different points.
  static BlockPartition of(const torch::Tensor& points, int blocks);

  int size() const { return static_cast<int>(splits_.size()) + 1; }
  /// Block of each position [n,3], int64 on its device.
  torch::Tensor block_of(const torch::Tensor& positions) const;
  /// The root first.
  const std::vector<Split>& splits() const { return splits_; }

 private:
  std::vector<Split> splits_;
};

}  // namespace apvi::mapping
