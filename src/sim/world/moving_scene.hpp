// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <bitset>
#include <cstdint>
#include <memory>

#include "sim/render/shading.hpp"
#include "sim/world/fish.hpp"

namespace apvi::sim {

/// Values of the images of truth/moving: something that moves, and its shadow on the world.
inline constexpr std::uint8_t kMovingBody = 255;
inline constexpr std::uint8_t kMovingShadow = 128;

/// What moves, at one instant. It is drawn over the rendered world, so that the world without it
/// stays known.
struct MovingScene {
  TriangleMesh mesh;
  BakedLight baked;  ///< shadows of the world on it, one value for each body
  RayCaster caster;

  MovingScene(const std::vector<FishPose>& fish, const RayCaster& world,
              const Eigen::Vector3f& sun);
};

/// Surfaces of a tile that sunlight may reach.
struct LitPoints {
  const Points& p;
  const Lanes &nx, &ny, &nz;
  Lanes& sun;  ///< visibility of the sun, which shadows lower
};
/// Lowers the visibility of the sun where `moving` casts a shadow; returns the points that lie in
/// one and face the sun.
std::bitset<kBatch> cast_shadows(const MovingScene& moving, const Eigen::Vector3f& sun,
                                 const LitPoints& points);

/// Casts the rays of `behind`, whose hits with the world are known, at what moves in front of
/// these. Rays without a hit get no range. Returns whether there is any hit.
bool cast_in_front(const MovingScene& moving, const TileRays& behind, TileRays& front);

}  // namespace apvi::sim
