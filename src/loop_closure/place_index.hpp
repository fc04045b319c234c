// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "loop_closure/place_map.hpp"

namespace apvi::loop_closure {

/// Finds the places of a map that share features with an image: an inverted file over the
/// descriptors (Jégou, Douze, Schmid, "Product quantization for nearest neighbor search", 2011,
/// section IV, without the compression). The cells are those of descriptors drawn from the map, so
/// there is no vocabulary to train or to ship. Time per image grows with the square root of the
/// map. Deterministic.
class PlaceIndex {
 public:
  explicit PlaceIndex(const PlaceMap& map);

  /// At most `count` places, the one with the most nearest neighbors first. `descriptors`: [n,128]
  /// 8-bit.
  std::vector<std::size_t> query(const cv::Mat& descriptors, std::size_t count) const;

 private:
  using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  struct Entry {
    std::uint32_t place = 0;
    std::uint32_t row = 0;
  };
  struct Neighbor {
    std::uint32_t place = 0;
    int squared_distance = 0;
  };

  /// The `kProbes` nearest cells of every descriptor, row by row.
  std::vector<std::vector<Eigen::Index>> nearest_cells(const cv::Mat& descriptors,
                                                       std::size_t count) const;
  void add_votes(const unsigned char* descriptor, const std::vector<Eigen::Index>& cells,
                 std::vector<int>& votes) const;

  std::vector<cv::Mat> descriptors_;  ///< by place
  Rows centers_;
  std::vector<std::vector<Entry>> cells_;
};

}  // namespace apvi::loop_closure
