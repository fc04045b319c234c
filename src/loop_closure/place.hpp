// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "loop_closure/level_pose.hpp"

namespace apvi::loop_closure {

/// A place: the features of an image, triangulated where another image allows it.
struct Place {
  std::vector<Eigen::Vector2d> rays;  ///< on the plane z = 1
  cv::Mat descriptors;                ///< [n,128] 8-bit SIFT, one row per ray
  std::vector<std::optional<Eigen::Vector3d>>
      points;  ///< in the camera frame, one per ray [m]; nullopt: not triangulated

  std::size_t triangulated_count() const;
  /// Distance of the farthest triangulated point [m]; zero without one.
  double reach_m() const;
};

/// A BGR or gray image in gray.
cv::Mat to_gray(const cv::Mat& image);

/// The camera of the images that features are extracted from: larger images than 1280 pixels are
/// reduced before, as every size has as many features as are kept, and SIFT takes seconds in 4K.
CameraModel feature_camera(const CameraModel& camera);

/// Extracts at most `max_features` SIFT features (Lowe, 2004) from an 8-bit gray image after
/// contrast equalization, as contrast decreases with distance under water. The lens need not be a
/// pinhole: rays are undistorted. `mask`: see CameraCalibration.
Place describe_place(const cv::Mat& gray, const CameraModel& recorded, int max_features,
                     const cv::Mat& mask = {});

inline constexpr int kDescriptorSize = 128;
/// Squared distance of two descriptors.
int squared_distance(const unsigned char* a, const unsigned char* b);

/// How likely a feature of a point is matched when it is seen from two cameras, relative to the
/// same view: by the angle between the two lines of sight and the ratio of the distances. Both
/// points in the orientation of one camera.
double match_probability(const Eigen::Vector3d& then, const Eigen::Vector3d& now);

/// What one camera should show of a place that another has seen.
struct VisiblePart {
  double fraction = 0.0;  ///< of the points, at a similar distance
  double matches = 0.0;   ///< expected number, from the change of each point's view
};
VisiblePart visible_part(const Place& then, const SE3& T_now_then, const CameraModel& camera);

/// Mutual nearest neighbors that pass the ratio test.
std::vector<std::pair<int, int>> match_features(const Place& a, const Place& b);

/// Triangulates the features of `place` that have no depth yet and match `other`. `T_other_place`:
/// pose of the camera of `place` in that of `other`; `sigma`: of a ray on the plane z = 1.
void triangulate_points(Place& place, const Place& other, const SE3& T_other_place, double sigma);

/// As above for all features: points from a wider baseline replace those that `place` has.
void retriangulate_points(Place& place, const Place& other, const SE3& T_other_place, double sigma);

/// Relative pose of two views of one place.
struct PlaceMatch {
  SE3 T_now_then;
  int inliers = 0;
  int matches = 0;                    ///< matches with a triangulated point
  std::vector<PointOnRay> seen = {};  ///< the inliers, points in the camera frame of then
};

/// RANSAC perspective-n-point from the points of `then` matched in `now`. Nullopt unless at least
/// `min_inliers` points and a sufficient fraction of the matches agree within three `sigma`.
std::optional<PlaceMatch> recognize_place(const Place& then, const Place& now, double sigma,
                                          int min_inliers);

}  // namespace apvi::loop_closure
