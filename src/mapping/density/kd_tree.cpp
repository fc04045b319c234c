// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/kd_tree.hpp"

#include <algorithm>
#include <numeric>

namespace apvi::mapping {

struct KdTree::Search {
  std::int64_t query;
  std::size_t count;
  const float* at;
  std::vector<float> found;  // max heap of squared distances

  bool accepts(float squared) const { return found.size() < count || squared < found.front(); }
  void add(float squared) {
    if (!accepts(squared)) return;
    if (found.size() == count) {
      std::pop_heap(found.begin(), found.end());
      found.pop_back();
    }
    found.push_back(squared);
    std::push_heap(found.begin(), found.end());
  }
};

KdTree::KdTree(const float* points, std::int64_t count)
    : points_(points), order_(static_cast<std::size_t>(count)) {
  std::iota(order_.begin(), order_.end(), std::int64_t{0});
  build(0, count, 0);
}

void KdTree::build(std::int64_t begin, std::int64_t end, int depth) {
  if (end - begin < 2) return;
  const std::int64_t middle = begin + (end - begin) / 2;
  const int axis = depth % 3;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                   [this, axis](std::int64_t a, std::int64_t b) {
                     return points_[3 * a + axis] < points_[3 * b + axis];
                   });
  build(begin, middle, depth + 1);
  build(middle + 1, end, depth + 1);
}

void KdTree::visit(Search& search, std::int64_t begin, std::int64_t end, int depth) const {
  if (begin >= end) return;
  const std::int64_t middle = begin + (end - begin) / 2;
  const float* const p = point(middle);
  if (order_[static_cast<std::size_t>(middle)] != search.query) {
    const float dx = p[0] - search.at[0];
    const float dy = p[1] - search.at[1];
    const float dz = p[2] - search.at[2];
    search.add(dx * dx + dy * dy + dz * dz);
  }
  const float across = search.at[depth % 3] - p[depth % 3];
  const bool low_first = across < 0.0F;
  for (const bool low : {low_first, !low_first}) {
    if (low != low_first && !search.accepts(across * across)) continue;
    if (low) {
      visit(search, begin, middle, depth + 1);
    } else {
      visit(search, middle + 1, end, depth + 1);
    }
  }
}

std::vector<float> KdTree::nearest(std::int64_t query, std::size_t count) const {
  if (count == 0) return {};
  Search search = {.query = query, .count = count, .at = points_ + 3 * query, .found = {}};
  visit(search, 0, static_cast<std::int64_t>(order_.size()), 0);
  std::sort_heap(search.found.begin(), search.found.end());
  return search.found;
}

}  // namespace apvi::mapping
