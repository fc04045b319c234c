// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

namespace apvi::mapping {

/// Balanced k-d tree for nearest neighbors in O(log N), stored implicitly in an array of indices
/// (the median of every range is its root).
class KdTree {
 public:
  /// `points`: N x 3, finite; must outlive the tree.
  KdTree(const float* points, std::int64_t count);

  /// Squared distances from point `query` to its `count` nearest neighbors, ascending; fewer when
  /// there are not that many points.
  std::vector<float> nearest(std::int64_t query, std::size_t count) const;

 private:
  struct Search;
  void build(std::int64_t begin, std::int64_t end, int depth);
  void visit(Search& search, std::int64_t begin, std::int64_t end, int depth) const;
  const float* point(std::int64_t place) const {
    return points_ + 3 * order_[static_cast<std::size_t>(place)];
  }

  const float* points_;
  std::vector<std::int64_t> order_;
};

}  // namespace apvi::mapping
