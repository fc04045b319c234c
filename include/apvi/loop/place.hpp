// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "apvi/geometry/se3.hpp"

namespace apvi::loop {

/// A camera without distortion; the middle of the first pixel is (0.5, 0.5).
struct Pinhole {
  double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;  ///< [px]
  int width = 0, height = 0;                      ///< [px]
};

/// What a picture looked like from somewhere: features, and how far away they are where another
/// picture has told.
struct Place {
  std::vector<Eigen::Vector2d> rays;                   ///< on the plane z = 1 before the camera
  cv::Mat descriptors;                                 ///< [n,128] 8-bit SIFT, a row for each ray
  std::vector<std::optional<Eigen::Vector3d>> points;  ///< before the camera, one for each ray [m]

  std::size_t depths() const;
};

/// At most `most` features (SIFT after Lowe, 2004) of an 8-bit grey picture whose contrast is made
/// even first: water takes it away with distance.
Place describe(const cv::Mat& grey, const Pinhole& camera, int most);

/// Pairs of features that are each other's most alike, and much more so than the second best.
std::vector<std::pair<int, int>> match(const Place& a, const Place& b);

/// Triangulates what both see and `place` has no depth of. `T_other_place`: between the cameras;
/// `sigma`: of a ray on the plane z = 1.
void give_depth(Place& place, const Place& other, const SE3& T_other_place, double sigma);

/// Where a picture was taken, as another of the same place has it.
struct Sighting {
  SE3 T_now_then;
  int inliers = 0;
  int matches = 0;  ///< with known depth
};

/// Perspective-n-point with RANSAC over what `now` sees of the points of `then`. Nothing unless
/// `least` points, and most of what is alike, agree within three `sigma`.
std::optional<Sighting> recognise(const Place& then, const Place& now, double sigma, int least);

}  // namespace apvi::loop
