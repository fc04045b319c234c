// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

namespace apvi::vio {

/// Default minimum distance between corners [px]: a little more than half of what `max_corners`
/// corners have on a square grid over the image, so that they fit where texture is uneven. At least
/// 25 px, because closer corners share their surroundings and with them their errors, but less in
/// images of less than 320 px, in proportion to their area, so that they have corners enough.
double corner_distance(cv::Size image, int max_corners);

/// Detects Shi-Tomasi corners where there are too few: the image is divided into cells, each filled
/// up to a fixed number, so that corners cover the image.
class CornerGrid {
 public:
  /// No corner is where `mask`, of the image's size, is zero; empty: everywhere.
  CornerGrid(cv::Size image, int max_corners, double min_distance_px, const cv::Mat& mask = {});

  /// Returns new corners, strongest first, at least `min_distance_px` from each other and from
  /// `existing`, at most `max_corners` in total. `half_gradient`: Scharr gradient at half the image
  /// size (CV_16SC2) from the flow pyramid. Flow compares patches, so corners at half size suit it
  /// better than single-pixel corners, at a quarter of the cost.
  std::vector<cv::Point2f> find(const cv::Mat& half_gradient,
                                const std::vector<cv::Point2f>& existing);

 private:
  struct Corner {
    cv::Point pixel;  // at half size
    float strength = 0.0F;
  };

  int cell_of(cv::Point p) const;  // cell of a pixel at half size; -1: outside
  std::vector<Corner> peaks(const std::vector<int>& missing) const;

  cv::Size half_;
  cv::Mat hidden_;  // 255 where there are no corners, at half size; may be empty
  int max_corners_;
  double min_distance_px_;
  int columns_ = 1;
  int rows_ = 1;
  cv::Mat strength_;  // of the last image; a member to avoid allocations
};

/// Fraction of the cells of an 8x6 grid that contain a point, in [0, 1].
double spread(const std::vector<cv::Point2f>& points, cv::Size image);

}  // namespace apvi::vio
