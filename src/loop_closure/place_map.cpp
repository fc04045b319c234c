// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/place_map.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

#include "loop_closure/ray_intersection.hpp"

namespace apvi::loop_closure {
namespace {

constexpr std::size_t kNeighbors = 4;  // places on either side
constexpr double kInlierSigmas = 3.0;
constexpr double kMinParallax = 0.04;  // [rad]
constexpr std::size_t kMinPoints = 8;  // of a place

MapRay ray_of(const PosedPlace& place, int feature) {
  const Eigen::Vector2d& ray = place.place->rays[static_cast<std::size_t>(feature)];
  return {place.T_map_camera.translation,
          place.T_map_camera.rotation * ray.homogeneous().normalized()};
}

std::optional<Eigen::Vector3d> triangulate(std::vector<MapRay> rays, double sigma) {
  const MapRay own = rays.front();
  if (parallax(own, rays) < kMinParallax) return std::nullopt;
  const Eigen::Vector3d point = nearest_point(rays);
  return fits(point, rays, kInlierSigmas * sigma) ? std::optional(point) : std::nullopt;
}

/// For every feature of every place, its ray and those of its matches.
using Rays = std::vector<std::vector<std::vector<MapRay>>>;

Rays match_neighbors(const std::vector<PosedPlace>& places) {
  Rays rays(places.size());
  for (std::size_t a = 0; a < places.size(); ++a) {
    const int features = static_cast<int>(places[a].place->rays.size());
    for (int i = 0; i < features; ++i) rays[a].push_back({ray_of(places[a], i)});
  }
  for (std::size_t a = 0; a < places.size(); ++a) {
    for (std::size_t b = a + 1; b < std::min(places.size(), a + 1 + kNeighbors); ++b) {
      for (const auto& [i, j] : match_features(*places[a].place, *places[b].place)) {
        rays[a][static_cast<std::size_t>(i)].push_back(ray_of(places[b], j));
        rays[b][static_cast<std::size_t>(j)].push_back(ray_of(places[a], i));
      }
    }
  }
  return rays;
}

MapPlace triangulate_place(const PosedPlace& place, const std::vector<std::vector<MapRay>>& rays,
                           double sigma) {
  MapPlace result{place.stamp, place.T_map_camera, {}, {}};
  const SE3 T_camera_map = place.T_map_camera.inverse();
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const auto point = triangulate(rays[i], sigma);
    if (!point) continue;
    result.points.emplace_back((T_camera_map * *point).cast<float>());
    result.descriptors.push_back(place.place->descriptors.row(static_cast<int>(i)));
  }
  return result;
}

}  // namespace

Place to_place(const MapPlace& place) {
  Place result;
  result.descriptors = place.descriptors;
  for (const Eigen::Vector3f& point : place.points) {
    result.points.emplace_back(point.cast<double>());
    result.rays.emplace_back(result.points.back()->hnormalized());
  }
  return result;
}

PlaceMap make_place_map(const std::vector<PosedPlace>& places, double sigma) {
  const Rays rays = match_neighbors(places);
  PlaceMap map;
  for (std::size_t k = 0; k < places.size(); ++k) {
    MapPlace place = triangulate_place(places[k], rays[k], sigma);
    if (place.points.size() >= kMinPoints) map.places.push_back(std::move(place));
  }
  return map;
}

}  // namespace apvi::loop_closure
