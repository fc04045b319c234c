// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <vector>

#include "importer/lens_adjustment.hpp"

namespace apvi::importer {

/// Corners of some parts of the images of a camera, in pixels of images of this size: large images
/// are reduced.
struct FollowedCorners {
  ImageSize size;
  std::vector<TrackSegment> segments;
};

/// Follows corners through some parts of the images, which have the given size and are in order of
/// time. Parts do not overlap. Each goes from one image on until half of the corners have moved by
/// a fifth of the image's width, or few are left, or it has a quarter of all images, or 60. Parts
/// in which they move by less than a fortieth are left out. Without segments when interrupted.
FollowedCorners follow_corners(const std::vector<std::filesystem::path>& images, ImageSize size,
                               const std::function<bool()>& interrupted);

}  // namespace apvi::importer
