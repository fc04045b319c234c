// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "apvi/geometry/se3.hpp"
#include "dipo/initializer.hpp"

namespace apvi::dipo {

/// The error that all poses of a segment share: its heading and position relative to the segments
/// before, as the motion in the pause between them is unknown. It is not part of the filter's
/// covariance, which describes the motion within the segment: a large heading variance there would
/// become information about the heading when the attitude is linearized again.
class SegmentError {
 public:
  using Matrix6 = Eigen::Matrix<double, 6, 6>;

  /// The first segment: no error.
  SegmentError() = default;
  /// `pose`: the last one before a pause of `pause_s` [s], where the new segment continues.
  /// `covariance`: of its error, tangent [rotation [rad] in the body frame, position [m] in the
  /// world]. `height`: the height is unknown after the pause, too; false if it is measured.
  SegmentError(const SE3& pose, const Matrix6& covariance, double pause_s, bool height);

  /// Covariance of the shared error at a pose of the segment, tangent as above.
  Matrix6 covariance(const SE3& pose) const;

 private:
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  Eigen::Matrix4d heading_position_ = Eigen::Matrix4d::Zero();
};

/// The end of a segment: the filter before a pause in the inertial data.
struct Segment {
  Stamp end;
  Eskf filter;
  SegmentError error;
};

/// The start of a new segment: attitude and velocity as in `fresh`, which the initializer found
/// after the pause; heading, position and calibration continue from `before`. Variances are those
/// within the new segment: heading and horizontal position are exact at its start. The height is
/// that of `fresh` if it is measured; otherwise its variance grows over the pause.
Initializer::Start continue_segment(const Segment& before, const Initializer::Start& fresh,
                                    const CalibrationRandomWalk& walk, const Rig& rig);

/// The error that the poses of the new segment share.
SegmentError error_after(const Segment& before, const Initializer::Start& fresh);

}  // namespace apvi::dipo
