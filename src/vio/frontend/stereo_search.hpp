// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "vio/frontend/frame_image.hpp"

namespace apvi::vio {

/// Match of a corner of the first camera in the second.
struct StereoMatch {
  cv::Point2f pixel;           ///< [px]
  Eigen::Vector2d point;       ///< on the plane z = 1 of the second camera
  double inverse_depth = 0.0;  ///< along the optical axis of the first camera [1/m]
};

/// A corner to be matched.
struct StereoQuery {
  cv::Point2f pixel;                    ///< in the first camera [px]
  Eigen::Vector2d point;                ///< on the plane z = 1 of the first camera
  std::optional<double> inverse_depth;  ///< from an earlier frame [1/m]
};

/// Matches corners of one camera in the simultaneous image of the other: optical flow starting at
/// the position for the known or median depth, checked against the epipolar geometry.
class StereoSearch {
 public:
  StereoSearch(const CameraCalibration& first, const CameraCalibration& second,
               double max_forward_backward_px, double max_epipolar_px);

  /// Returns one result per query.
  std::vector<std::optional<StereoMatch>> find(const FrameImage& first, const FrameImage& second,
                                               const std::vector<StereoQuery>& queries);

 private:
  cv::Point2f guess(const StereoQuery& query) const;
  std::optional<StereoMatch> check(const StereoQuery& query, const cv::Point2f& pixel) const;

  CameraModel second_;
  SE3 T_second_first_;
  Eigen::Matrix3d essential_;
  double max_backward_px_;
  double max_epipolar_;                // on the plane z = 1
  double median_inverse_depth_ = 0.3;  // median of the last matches [1/m]
};

}  // namespace apvi::vio
