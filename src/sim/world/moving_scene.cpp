// SPDX-License-Identifier: BSD-3-Clause
#include "sim/world/moving_scene.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::sim {
namespace {

using Eigen::Vector3f;

constexpr float kMaxRange = 200.0F;    // [m]; as for the world
constexpr float kShadowRange = 5.0F;   // [m]; as for the baked shadows of the world
constexpr float kShadowBias = 0.004F;  // [m]
// Rays toward the sun; waves and scattering spread its light, as for the baked shadows.
constexpr int kSunRays = 9;
constexpr float kSpread = 0.06F;  // [rad]

TriangleMesh bodies(const std::vector<FishPose>& fish) {
  TriangleMesh mesh;
  for (const FishPose& pose : fish) add_fish(mesh, pose);
  return mesh;
}

// The light at the middle of every fish, for all of its vertices.
BakedLight light_on(const TriangleMesh& mesh, const std::vector<FishPose>& fish,
                    const RayCaster& world, const Vector3f& sun) {
  TriangleMesh middles;
  for (const FishPose& pose : fish) middles.add_vertex(pose.T_world_fish.translation());
  const BakedLight coarse = bake_light(middles, world, sun, 1);
  BakedLight baked{.normals = vertex_normals(mesh), .sky = {}, .sun = {}};
  const std::size_t each = fish_vertex_count();
  for (std::size_t k = 0; k < fish.size(); ++k) {
    baked.sky.insert(baked.sky.end(), each, coarse.sky[k]);
    baked.sun.insert(baked.sun.end(), each, coarse.sun[k]);
  }
  return baked;
}

float sunlit(const RayCaster& caster, const Vector3f& from, const Vector3f& sun) {
  const Vector3f a = sun.unitOrthogonal();
  const Vector3f b = sun.cross(a);
  int open = 0;
  for (int k = 0; k < kSunRays; ++k) {  // evenly distributed (golden-angle spiral on the disc)
    const float radius = kSpread * std::sqrt((static_cast<float>(k) + 0.5F) / kSunRays);
    const float angle = 2.399963F * static_cast<float>(k);
    const Vector3f toward =
        (sun + radius * (std::cos(angle) * a + std::sin(angle) * b)).normalized();
    if (!caster.occluded(from, toward, kShadowRange)) ++open;
  }
  return static_cast<float>(open) / kSunRays;
}

}  // namespace

MovingScene::MovingScene(const std::vector<FishPose>& fish, const RayCaster& world,
                         const Vector3f& sun)
    : mesh(bodies(fish)), baked(light_on(mesh, fish, world, sun)), caster(mesh) {}

std::bitset<kBatch> cast_shadows(const MovingScene& moving, const Vector3f& sun,
                                 const LitPoints& points) {
  std::bitset<kBatch> shadowed;
  for (int i = 0; i < points.p.count; ++i) {
    const Vector3f n(points.nx[i], points.ny[i], points.nz[i]);
    if (n.dot(sun) <= 0.0F) continue;
    const Vector3f p(points.p.x[i], points.p.y[i], points.p.z[i]);
    const float open = sunlit(moving.caster, p + kShadowBias * n, sun);
    if (open == 1.0F) continue;
    points.sun[i] *= open;
    shadowed.set(static_cast<std::size_t>(i));
  }
  return shadowed;
}

bool cast_in_front(const MovingScene& moving, const TileRays& behind, TileRays& front) {
  front.rays = behind.rays;
  front.pixel_angle = behind.pixel_angle;
  front.lamp_position = behind.lamp_position;
  front.lamp_axis = behind.lamp_axis;
  for (std::size_t i = 0; i < front.rays.size(); ++i) {
    const bool no_ray =
        front.rays.dx[i] == 0.0F && front.rays.dy[i] == 0.0F && front.rays.dz[i] == 0.0F;
    if (front.rays.range[i] < 0.0F) front.rays.range[i] = no_ray ? 1e-3F : kMaxRange;
  }
  moving.caster.cast(front.rays);
  return std::any_of(front.rays.range.begin(), front.rays.range.end(),
                     [](float range) { return range >= 0.0F; });
}

}  // namespace apvi::sim
