// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "importer/assumed_camera.hpp"

/// How well a lens explains corners that were followed through images.
namespace apvi::importer {

/// Corners of some images in a row: `tracks[i][k]` is where image k shows corner i [px]. Every
/// image shows every corner.
struct TrackSegment {
  std::vector<std::vector<Eigen::Vector2d>> tracks;

  std::size_t images() const { return tracks.empty() ? 0 : tracks.front().size(); }
};

/// How rays map to pixels: the lens, and whether a flat port under water is before it.
struct LensShape {
  Lens lens = Lens::rectilinear;
  bool port = false;
};

struct LensFit {
  double focal_px = 0.0;  ///< of the lens in air
  /// By segment: mean of the robust squared reprojection error of a coordinate [px²]; NaN if no
  /// motion of the camera was found.
  std::vector<double> cost;
  double total = 0.0;  ///< geometric mean of those; infinite without any
};

/// The ray of a pixel, with z = 1; `from_center` is its position from the principal point [px].
/// Rays beyond 86 degrees in air are bent to that.
Eigen::Vector3d ray_of(const LensShape& shape, double focal_px, const Eigen::Vector2d& from_center);
/// The inverse, for a ray of any length.
Eigen::Vector2d pixel_of(const LensShape& shape, double focal_px, const Eigen::Vector3d& ray);

/// Bundle adjustment of all segments, with the principal point in the middle of the image: motions
/// by the five-point method between first and last image, then poses, points and, if `free_focal`,
/// the focal length that all segments share, with a Huber loss of 1 px.
LensFit fit_lens(const LensShape& shape, double focal_px, bool free_focal, ImageSize size,
                 const std::vector<TrackSegment>& segments);

}  // namespace apvi::importer
