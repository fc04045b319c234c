// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <mutex>
#include <numbers>
#include <thread>

#include "sim/render/shading.hpp"

namespace apvi::sim {
namespace {

constexpr int kSkyRays = 12;
constexpr float kSkyRange = 1.2F;  // [m]; farther occluders are outshone by scattered light
constexpr int kSunRays = 2;
constexpr float kSunRange = 5.0F;  // [m]
constexpr int kBlock = 4096;

// Cosine-weighted directions about z, evenly distributed (golden-angle spiral on the disc).
std::vector<Eigen::Vector3f> sky_directions() {
  std::vector<Eigen::Vector3f> directions;
  for (int i = 0; i < kSkyRays; ++i) {
    const float radius = std::sqrt((static_cast<float>(i) + 0.5F) / kSkyRays);
    const float angle = 2.399963F * static_cast<float>(i);  // golden angle
    directions.emplace_back(radius * std::cos(angle), radius * std::sin(angle),
                            std::sqrt(1.0F - radius * radius));
  }
  return directions;
}

// Two unit vectors that form a right-handed frame with n, rotated about it by `angle`.
void frame_about(const Eigen::Vector3f& n, float angle, Eigen::Vector3f& a, Eigen::Vector3f& b) {
  const Eigen::Vector3f helper =
      std::abs(n.z()) < 0.9F ? Eigen::Vector3f::UnitZ() : Eigen::Vector3f::UnitX();
  const Eigen::Vector3f u = helper.cross(n).normalized();
  const Eigen::Vector3f w = n.cross(u);
  a = std::cos(angle) * u + std::sin(angle) * w;
  b = n.cross(a);
}

float unoccluded_sky(const RayCaster& caster, const Eigen::Vector3f& p, const Eigen::Vector3f& n,
                     const std::vector<Eigen::Vector3f>& directions, std::uint32_t key) {
  Eigen::Vector3f a;
  Eigen::Vector3f b;
  frame_about(n, 2.0F * std::numbers::pi_v<float> * unit_float(hash32(key)), a, b);
  int open = 0;
  for (const Eigen::Vector3f& d : directions) {
    if (!caster.occluded(p, d.x() * a + d.y() * b + d.z() * n, kSkyRange)) ++open;
  }
  return static_cast<float>(open) / kSkyRays;
}

float unoccluded_sun(const RayCaster& caster, const Eigen::Vector3f& p, const Eigen::Vector3f& sun,
                     std::uint32_t key) {
  int open = 0;
  for (std::uint32_t k = 0; k < kSunRays;
       ++k) {  // jittered: waves and scattering spread the sunlight
    const Eigen::Vector3f shift(unit_float(hash32(key, 3 * k)) - 0.5F,
                                unit_float(hash32(key, 3 * k + 1)) - 0.5F,
                                unit_float(hash32(key, 3 * k + 2)) - 0.5F);
    if (!caster.occluded(p, (sun + 0.25F * shift).normalized(), kSunRange)) ++open;
  }
  return static_cast<float>(open) / kSunRays;
}

}  // namespace

BakedLight bake_light(const TriangleMesh& mesh, const RayCaster& caster, const Eigen::Vector3f& sun,
                      int threads) {
  BakedLight baked;
  baked.normals = vertex_normals(mesh);
  baked.sky.assign(mesh.vertices.size(), 1.0F);
  baked.sun.assign(mesh.vertices.size(), 1.0F);
  const std::vector<Eigen::Vector3f> directions = sky_directions();
  const int count = static_cast<int>(mesh.vertices.size());
  parallel_for((count + kBlock - 1) / kBlock, threads, [&](int block) {
    for (int i = block * kBlock; i < std::min(count, (block + 1) * kBlock); ++i) {
      const auto index = static_cast<std::size_t>(i);
      const Eigen::Vector3f& n = baked.normals[index];
      const Eigen::Vector3f p = mesh.vertices[index] + 0.004F * n;
      const auto key = static_cast<std::uint32_t>(i);
      baked.sky[index] = unoccluded_sky(caster, p, n, directions, key);
      baked.sun[index] = n.dot(sun) > 0.0F ? unoccluded_sun(caster, p, sun, key) : 1.0F;
    }
  });
  return baked;
}

void parallel_for(int count, int threads, const std::function<void(int)>& work) {
  std::atomic<int> next{0};
  std::exception_ptr error;
  std::mutex mutex;
  const auto loop = [&] {
    try {
      for (int i = next++; i < count; i = next++) work(i);
    } catch (...) {
      const std::scoped_lock lock(mutex);
      error = std::current_exception();
      next = count;
    }
  };
  {
    std::vector<std::jthread> helpers;
    for (int t = 1; t < std::min(threads, count); ++t) helpers.emplace_back(loop);
    loop();
  }
  if (error) std::rethrow_exception(error);
}

}  // namespace apvi::sim
