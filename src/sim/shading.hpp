// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "apvi/sim/light.hpp"
#include "apvi/sim/mesh.hpp"
#include "apvi/sim/noise_texture.hpp"
#include "apvi/sim/ray_caster.hpp"
#include "apvi/sim/water.hpp"

namespace apvi::sim {

/// Everything about light that is the same over a picture.
struct LightState {
  LightConfig config;  ///< intensities already scaled by the darkness of the moment
  Medium medium;       ///< b_inf too
  double veil_gradient = 0.0;
  double silt = 0.0;
  double time_s = 0.0;
  Eigen::Vector3f silt_colour = Eigen::Vector3f::Zero();  ///< light that a dense cloud sends back
};

/// Up to kBatch neighbouring rays of one pose, and what they see. Structure of arrays; unused lanes
/// hold copies of the first ray.
struct TileRays {
  RayBatch rays;
  Lanes pixel_angle;  ///< angle between neighbouring pixels [rad]
  Eigen::Vector3f lamp_position = Eigen::Vector3f::Zero();  ///< world [m]
  Eigen::Vector3f lamp_axis = Eigen::Vector3f::UnitX();     ///< world, unit
  Lanes clear[3];  ///< J: red, green, blue; 0 where nothing is
  Lanes seen[3];   ///< I: through the water
};

/// Light that reaches the vertices of a mesh: how much of the sky and of the sun they see, 0 to 1.
struct BakedLight {
  std::vector<Eigen::Vector3f> normals;
  std::vector<float> sky;
  std::vector<float> sun;
};
BakedLight bake_light(const TriangleMesh& mesh, const RayCaster& caster, const Eigen::Vector3f& sun,
                      int threads);

/// Colours of what the (already cast) rays hit, without and with water.
void shade(const TriangleMesh& mesh, const BakedLight& baked, const LightState& light,
           TileRays& tile);

/// Runs `work(index)` for 0 to count - 1 on `threads` threads, in no particular order. An exception
/// ends the work and is thrown here.
void parallel_for(int count, int threads, const std::function<void(int)>& work);

}  // namespace apvi::sim
