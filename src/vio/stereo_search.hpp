// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "vio/frame_image.hpp"

namespace apvi::vio {

/// A corner of the first camera as the second one sees it.
struct StereoMatch {
  cv::Point2f pixel;           ///< [px]
  Eigen::Vector2d point;       ///< on the plane z = 1 of the second camera
  double inverse_depth = 0.0;  ///< along the optical axis of the first camera [1/m]
};

/// What is looked for.
struct StereoQuery {
  cv::Point2f pixel;                    ///< in the first camera [px]
  Eigen::Vector2d point;                ///< on its plane z = 1
  std::optional<double> inverse_depth;  ///< of an earlier frame [1/m]
};

/// Looks for the corners of one camera in the other's image of the same instant: optical flow from
/// where the known or usual depth puts them, checked against the known epipolar geometry.
class StereoSearch {
 public:
  StereoSearch(const CameraCalibration& first, const CameraCalibration& second,
               double max_backward_px, double max_epipolar_px);

  /// One result for every query.
  std::vector<std::optional<StereoMatch>> find(const FrameImage& first, const FrameImage& second,
                                               const std::vector<StereoQuery>& queries);

 private:
  cv::Point2f guess(const StereoQuery& query) const;
  std::optional<StereoMatch> check(const StereoQuery& query, const cv::Point2f& pixel) const;

  CameraModel second_;
  SE3 T_second_first_;
  Eigen::Matrix3d essential_;
  double max_backward_px_;
  double max_epipolar_;               // on the plane z = 1
  double usual_inverse_depth_ = 0.3;  // median of what was found last [1/m]
};

}  // namespace apvi::vio
