// SPDX-License-Identifier: BSD-3-Clause
#include "sim/world/fish.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "apvi/core/error.hpp"
#include "core/random.hpp"
#include "sim/world/world.hpp"
#include "sim/world/world_parts.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr std::uint64_t kFishStream = 7;
constexpr double kTwoPi = 2.0 * std::numbers::pi;
// A tail beat moves a fish by about 0.7 of its length (Bainbridge, J. Exp. Biol. 35, 1958).
constexpr double kStride = 0.7;
constexpr double kMinBeatRate = 2.0;  // [rad/s], of a fish that hardly moves

// x along the velocity, z up.
Eigen::Matrix3f heading(const Vector3d& velocity, double angle) {
  Vector3d forward = velocity;
  if (forward.norm() < 1e-6) forward = Vector3d(-std::sin(angle), std::cos(angle), 0.0);
  forward.normalize();
  const Vector3d left = Vector3d::UnitZ().cross(forward).normalized();
  Eigen::Matrix3f R;
  R.col(0) = forward.cast<float>();
  R.col(1) = left.cast<float>();
  R.col(2) = forward.cross(left).cast<float>();
  return R;
}

}  // namespace

double Fish::Wave::value(double t) const {
  return amplitude * std::sin(rate * t + phase);
}

double Fish::Wave::slope(double t) const {
  return amplitude * rate * std::cos(rate * t + phase);
}

Fish::Fish(const WorldConfig& world, std::uint64_t seed) {
  const parts::Terrain terrain(world, seed);
  for (const SchoolConfig& school : world.fish) {
    const auto bed = static_cast<double>(
        terrain.height(static_cast<float>(school.x_m), static_cast<float>(school.y_m)));
    add_school(school, bed, seed);
  }
}

void Fish::add_school(const SchoolConfig& school, double bed, std::uint64_t seed) {
  Random random = Random(seed).fork(kFishStream).fork(static_cast<std::uint64_t>(school.seed));
  const auto species = static_cast<std::uint16_t>(random.next() >> 48);
  const double turn = random.uniform() < 0.5 ? -1.0 : 1.0;
  const double start = random.uniform(0.0, kTwoPi);
  const double spread = school.length_m * std::cbrt(static_cast<double>(school.count));
  const auto wave = [&random](double amplitude) {
    return Wave{amplitude, random.uniform(0.3, 0.9), random.uniform(0.0, kTwoPi)};
  };
  for (int k = 0; k < school.count; ++k) {
    const double length = school.length_m * random.uniform(0.85, 1.15);
    const double along = spread * random.normal();
    const double across = std::max(-0.6 * school.radius_m, 0.5 * spread * random.normal());
    const double up =
        std::max(-0.5 * school.height_m, 0.3 * spread * random.normal()) + school.height_m;
    all_.push_back(
        {.center = Vector3d(school.x_m, school.y_m, bed + up),
         .radius = school.radius_m + across,
         .angle = start + along / school.radius_m,
         .turn_rate = turn * school.speed_m_s / school.radius_m,
         .across = wave(0.3 * length),
         .up = wave(0.15 * length),
         .beat_rate = std::max(kMinBeatRate, kTwoPi * school.speed_m_s / (kStride * length)),
         .beat_phase = random.uniform(0.0, kTwoPi),
         .length = static_cast<float>(length),
         .species = species});
  }
}

FishPose Fish::pose_of(const One& fish, double t) {
  const double angle = fish.angle + fish.turn_rate * t;
  const double radius = fish.radius + fish.across.value(t);
  const Vector3d outward(std::cos(angle), std::sin(angle), 0.0);
  const Vector3d around(-std::sin(angle), std::cos(angle), 0.0);
  FishPose pose{.T_world_fish = Eigen::Affine3f::Identity(),
                .velocity = fish.across.slope(t) * outward + radius * fish.turn_rate * around +
                            fish.up.slope(t) * Vector3d::UnitZ(),
                .length = fish.length,
                .beat = static_cast<float>(std::fmod(fish.beat_phase + fish.beat_rate * t, kTwoPi)),
                .species = fish.species};
  const Vector3d place = fish.center + radius * outward + fish.up.value(t) * Vector3d::UnitZ();
  pose.T_world_fish.translation() = place.cast<float>();
  pose.T_world_fish.linear() = heading(pose.velocity, angle);
  return pose;
}

std::vector<FishPose> Fish::at(double time_s) const {
  std::vector<FishPose> poses;
  poses.reserve(all_.size());
  for (const One& fish : all_) poses.push_back(pose_of(fish, time_s));
  return poses;
}

void check_fish(const WorldConfig& world) {
  const double half = 0.5 * world.size_m;
  for (const SchoolConfig& school : world.fish) {
    if (std::abs(school.x_m) <= half && std::abs(school.y_m) <= half) continue;
    fail_input("world.fish: a school at x {} m, y {} m is outside of world.size_m ({} m)",
               school.x_m, school.y_m, world.size_m);
  }
}

}  // namespace apvi::sim
