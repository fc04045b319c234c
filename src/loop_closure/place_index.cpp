// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/place_index.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace apvi::loop_closure {
namespace {

constexpr std::size_t kProbes = 8;  // cells searched for a descriptor
// Cells per square root of the number of descriptors.
constexpr double kCellsPerRoot = 2.0;
// Neighbors that are so much farther than the nearest one may show the same point from another
// place.
constexpr double kTie = 1.1;
// Descriptors compared at a time, to bound the memory.
constexpr int kChunk = 4096;

// Indices of the smallest values, in order; ties by index.
std::vector<Eigen::Index> smallest(const Eigen::RowVectorXf& values, std::size_t count) {
  std::vector<Eigen::Index> order(static_cast<std::size_t>(values.size()));
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  const auto end = order.begin() + static_cast<std::ptrdiff_t>(std::min(count, order.size()));
  std::partial_sort(order.begin(), end, order.end(), [&](Eigen::Index a, Eigen::Index b) {
    return values[a] < values[b] || (values[a] == values[b] && a < b);
  });
  order.erase(end, order.end());
  return order;
}

}  // namespace

PlaceIndex::PlaceIndex(const PlaceMap& map) {
  std::vector<Entry> all;
  for (const MapPlace& place : map.places) {
    const auto index = static_cast<std::uint32_t>(descriptors_.size());
    for (std::uint32_t row = 0; row < place.points.size(); ++row) all.push_back({index, row});
    descriptors_.push_back(place.descriptors);
  }
  const double root = std::sqrt(static_cast<double>(all.size()));
  const auto count =
      std::min(all.size(), static_cast<std::size_t>(std::ceil(kCellsPerRoot * root)));
  centers_.resize(static_cast<Eigen::Index>(count), kDescriptorSize);
  for (std::size_t c = 0; c < count; ++c) {
    const Entry& entry = all[c * all.size() / count];
    const unsigned char* row = descriptors_[entry.place].ptr(static_cast<int>(entry.row));
    for (int k = 0; k < kDescriptorSize; ++k) centers_(static_cast<Eigen::Index>(c), k) = row[k];
  }
  cells_.resize(count);
  for (std::uint32_t p = 0; p < descriptors_.size(); ++p) {
    const auto nearest = nearest_cells(descriptors_[p], 1);
    for (std::uint32_t row = 0; row < nearest.size(); ++row) {
      cells_[static_cast<std::size_t>(nearest[row].front())].push_back({p, row});
    }
  }
}

std::vector<std::vector<Eigen::Index>> PlaceIndex::nearest_cells(const cv::Mat& descriptors,
                                                                 std::size_t count) const {
  using Bytes = Eigen::Matrix<unsigned char, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  std::vector<std::vector<Eigen::Index>> nearest;
  if (centers_.rows() == 0) return nearest;
  const Eigen::RowVectorXf norms = centers_.rowwise().squaredNorm().transpose();
  for (int begin = 0; begin < descriptors.rows; begin += kChunk) {
    const cv::Mat chunk =
        descriptors.rowRange(begin, std::min(begin + kChunk, descriptors.rows)).clone();
    const Rows rows =
        Eigen::Map<const Bytes>(chunk.ptr(), chunk.rows, kDescriptorSize).cast<float>();
    Rows squared = -2.0F * rows * centers_.transpose();
    squared.rowwise() += norms;
    for (Eigen::Index i = 0; i < squared.rows(); ++i) {
      nearest.push_back(smallest(squared.row(i), count));
    }
  }
  return nearest;
}

void PlaceIndex::add_votes(const unsigned char* descriptor, const std::vector<Eigen::Index>& cells,
                           std::vector<int>& votes) const {
  std::vector<Neighbor> neighbors;
  int nearest = std::numeric_limits<int>::max();
  for (const Eigen::Index cell : cells) {
    for (const Entry& entry : cells_[static_cast<std::size_t>(cell)]) {
      const unsigned char* row = descriptors_[entry.place].ptr(static_cast<int>(entry.row));
      neighbors.push_back({entry.place, squared_distance(descriptor, row)});
      nearest = std::min(nearest, neighbors.back().squared_distance);
    }
  }
  for (const Neighbor& neighbor : neighbors) {
    if (neighbor.squared_distance <= kTie * kTie * nearest) ++votes[neighbor.place];
  }
}

std::vector<std::size_t> PlaceIndex::query(const cv::Mat& descriptors, std::size_t count) const {
  std::vector<int> votes(descriptors_.size(), 0);
  const auto cells = nearest_cells(descriptors, kProbes);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    add_votes(descriptors.ptr(static_cast<int>(i)), cells[i], votes);
  }
  std::vector<std::size_t> order(votes.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order,
                           [&](std::size_t a, std::size_t b) { return votes[a] > votes[b]; });
  order.resize(std::min(count, order.size()));
  return order;
}

}  // namespace apvi::loop_closure
