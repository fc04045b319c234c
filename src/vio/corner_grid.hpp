// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

namespace apvi::vio {

/// Finds Shi-Tomasi corners where there are too few: the image is divided into cells, and each is
/// filled up to a share, so that corners lie all over the image.
class CornerGrid {
 public:
  CornerGrid(cv::Size image, int max_corners, double min_distance_px);

  /// New corners, strongest first, at least `min_distance_px` from each other and from `taken`,
  /// which with them make at most `max_corners`. `half_gradient`: of the image at half its size
  /// (CV_16SC2, Scharr), as optical flow's pyramid holds it. Flow compares patches, so that what is
  /// a corner at half the size suits it better than what is one pixel by pixel, and takes a quarter
  /// of the time.
  std::vector<cv::Point2f> find(const cv::Mat& half_gradient,
                                const std::vector<cv::Point2f>& taken);

 private:
  struct Corner {
    cv::Point pixel;  // at half the size
    float strength = 0.0F;
  };

  int cell_of(cv::Point p) const;  // of a pixel at half the size; -1: outside of all
  std::vector<Corner> peaks(const std::vector<int>& missing) const;

  cv::Size half_;
  int max_corners_;
  double min_distance_px_;
  int columns_ = 1;
  int rows_ = 1;
  cv::Mat strength_;  // of the last image; here to spare its allocation
};

/// Share of the cells of an 8x6 grid over the image that hold a point, in [0, 1].
double spread(const std::vector<cv::Point2f>& points, cv::Size image);

}  // namespace apvi::vio
