// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/geometry/se3.hpp"
#include "loop_closure/place.hpp"

namespace apvi::loop_closure {

/// A place of a map, with the features whose position is known.
struct MapPlace {
  Stamp stamp;
  SE3 T_map_camera;
  std::vector<Eigen::Vector3f> points;  ///< in the camera frame [m]
  cv::Mat descriptors;                  ///< [n,128] 8-bit, one row per point
};

/// Its features as they are matched, all of them triangulated.
Place to_place(const MapPlace& place);

/// What a dive leaves for later ones to be found in: its places, in order of time.
struct PlaceMap {
  std::vector<MapPlace> places;
};

/// A place with its pose, as a dive has seen it.
struct PosedPlace {
  Stamp stamp;
  SE3 T_map_camera;
  const Place* place = nullptr;
};

/// Triangulates the features of every place anew from all places near it in time, by least squares
/// over the rays; they have a longer baseline than two neighbors. Points that do not fit all their
/// rays within three `sigma`, and those with little parallax, are left out.
PlaceMap make_place_map(const std::vector<PosedPlace>& places, double sigma);

/// Writes the file atomically. Throws RunError.
void save(const PlaceMap& map, const std::filesystem::path& path);
/// Throws InputError when the file is missing, damaged, or of another version.
PlaceMap load_place_map(const std::filesystem::path& path);

inline constexpr const char* kPlacesFile = "places.bin";  ///< in a run folder

/// The file of a run folder. Throws InputError when that has none or one that cannot be used.
std::filesystem::path find_place_map(const std::filesystem::path& run);

}  // namespace apvi::loop_closure
