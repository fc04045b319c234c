// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

namespace apvi::vio {

/// Finds Shi-Tomasi corners where there are too few. The image is divided into cells; only cells
/// that hold less than their share are searched, so that the cost follows what is missing.
class CornerGrid {
 public:
  CornerGrid(cv::Size image, int max_corners, double min_distance_px);

  /// New corners, strongest first, at least `min_distance_px` from each other and from `taken`,
  /// which with them make at most `max_corners`. 8-bit grey image of the constructor's size.
  std::vector<cv::Point2f> find(const cv::Mat& image, const std::vector<cv::Point2f>& taken) const;

 private:
  cv::Rect cell(int index) const;
  std::vector<int> count_per_cell(const std::vector<cv::Point2f>& points) const;

  cv::Size image_;
  int max_corners_;
  double min_distance_px_;
  int columns_ = 1;
  int rows_ = 1;
};

/// Share of the cells of an 8x6 grid over the image that hold a point, in [0, 1].
double spread(const std::vector<cv::Point2f>& points, cv::Size image);

}  // namespace apvi::vio
