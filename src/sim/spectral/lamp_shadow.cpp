// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/lamp_shadow.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace apvi::sim {
namespace {

using Eigen::Vector3f;

constexpr float kReach = 12.0F;  // [m]; lamps light nothing beyond
constexpr float kBias = 0.02F;   // [m]; roughness between the rays
constexpr float kSlope = 0.02F;  // per meter: spacing of the rays

}  // namespace

LampShadow::LampShadow(const LampPose& lamp, const RayCaster& world)
    : lamp_(lamp), right_(lamp.axis.unitOrthogonal()), down_(lamp.axis.cross(right_)) {
  RayBatch rays;
  rays.resize(kSize * kSize);
  for (int row = 0; row < kSize; ++row) {
    for (int column = 0; column < kSize; ++column) {
      const auto i = static_cast<std::size_t>(row * kSize + column);
      const float x = (2.0F * static_cast<float>(column) + 1.0F) / kSize - 1.0F;
      const float y = (2.0F * static_cast<float>(row) + 1.0F) / kSize - 1.0F;
      const float square = x * x + y * y;
      const float z = (1.0F - square) / (1.0F + square);
      const Vector3f d = ((1.0F + z) * (x * right_ + y * down_) + z * lamp.axis).normalized();
      rays.ox[i] = lamp.position.x();
      rays.oy[i] = lamp.position.y();
      rays.oz[i] = lamp.position.z();
      rays.dx[i] = d.x();
      rays.dy[i] = d.y();
      rays.dz[i] = d.z();
      rays.range[i] = z > 0.0F ? kReach : 1e-3F;
    }
  }
  world.cast(rays);
  range_ = std::move(rays.range);
  for (float& range : range_)
    if (range < 0.0F) range = kReach;
}

float LampShadow::lit(const Vector3f& p) const {
  const Vector3f ray = p - lamp_.position;
  const float range = ray.norm();
  const float z = ray.dot(lamp_.axis) / range;
  if (z <= 0.0F) return 1.0F;
  const float scale = 0.5F * kSize / (range * (1.0F + z));
  const float x = std::clamp(ray.dot(right_) * scale + 0.5F * kSize - 0.5F, 0.0F, kSize - 1.001F);
  const float y = std::clamp(ray.dot(down_) * scale + 0.5F * kSize - 0.5F, 0.0F, kSize - 1.001F);
  const int column = static_cast<int>(x);
  const int row = static_cast<int>(y);
  const float u = x - static_cast<float>(column);
  const float v = y - static_cast<float>(row);
  const float limit = range - kBias - kSlope * range;
  const float* at = &range_[static_cast<std::size_t>(row * kSize + column)];
  const auto open = [&](std::ptrdiff_t offset) { return at[offset] > limit ? 1.0F : 0.0F; };
  return (1.0F - v) * ((1.0F - u) * open(0) + u * open(1)) +
         v * ((1.0F - u) * open(kSize) + u * open(kSize + 1));
}

}  // namespace apvi::sim
