// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "sim/render/light.hpp"
#include "sim/render/ray_caster.hpp"
#include "sim/render/water.hpp"
#include "sim/world/mesh.hpp"
#include "sim/world/noise_texture.hpp"

namespace apvi::sim {

struct MovingScene;

/// Light parameters that are constant over an image.
struct LightState {
  LightConfig config;  ///< intensities already scaled by 1 - darkness
  Medium medium;       ///< b_inf scaled likewise
  double veiling_light_gradient = 0.0;
  double silt = 0.0;
  double time_s = 0.0;
  Eigen::Vector3f silt_color = Eigen::Vector3f::Zero();  ///< light scattered back by a dense cloud
  const MovingScene* moving = nullptr;                   ///< casts shadows; null: nothing moves
};

/// Up to kBatch neighboring rays of one pose and their colors, as a structure of arrays; unused
/// lanes hold copies of the first ray.
struct TileRays {
  RayBatch rays;
  Lanes pixel_angle{};  ///< angle between neighboring pixels [rad]
  Eigen::Vector3f lamp_position = Eigen::Vector3f::Zero();  ///< world [m]
  Eigen::Vector3f lamp_axis = Eigen::Vector3f::UnitX();     ///< world, unit
  Lanes clear[3]{};                           ///< J: red, green, blue; 0 for no surface
  Lanes observed[3]{};                        ///< I: through the water
  std::array<std::uint8_t, kBatch> moving{};  ///< kMovingBody, kMovingShadow or 0
};

/// Precomputed visibility of the sky and of the sun from the vertices of a mesh, 0 to 1.
struct BakedLight {
  std::vector<Eigen::Vector3f> normals;
  std::vector<float> sky;
  std::vector<float> sun;
};
BakedLight bake_light(const TriangleMesh& mesh, const RayCaster& caster, const Eigen::Vector3f& sun,
                      int threads);

/// Computes the colors of the surfaces hit by the (already cast) rays, without and with water.
void shade(const TriangleMesh& mesh, const BakedLight& baked, const LightState& light,
           TileRays& tile);

/// Runs `work(index)` for 0 to count - 1 on `threads` threads, in unspecified order. An exception
/// stops the work and is rethrown here.
void parallel_for(int count, int threads, const std::function<void(int)>& work);

}  // namespace apvi::sim
