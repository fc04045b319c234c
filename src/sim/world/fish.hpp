// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "apvi/config/fields.hpp"
#include "sim/world/mesh.hpp"

/// Fish that swim through the scene. They are no part of the world: see MovingScene.
namespace apvi::sim {

struct WorldConfig;

/// A school that circles over the bed.
struct SchoolConfig {
  int count = 12;
  double x_m = 0.0;
  double y_m = 0.0;
  double height_m = 0.6;
  double radius_m = 1.5;
  double length_m = 0.25;
  double speed_m_s = 0.3;
  int seed = 1;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("count", count, Range{1, 1000}, "number of fish");
    v("x_m", x_m, "center of the circle, east [m]");
    v("y_m", y_m, "center of the circle, north [m]");
    v("height_m", height_m, Range{0.1, 50.0}, "mean height above the bed at the center [m]");
    v("radius_m", radius_m, Range{0.3, 100.0}, "radius of the circle [m]");
    v("length_m", length_m, Range{0.05, 1.0}, "mean length of a fish [m]");
    v("speed_m_s", speed_m_s, Range{0.0, 5.0}, "mean speed [m/s]");
    v("seed", seed, Range{0, 2147483647}, "random seed of places, sizes, direction and species");
  }
};

/// Where one fish is. In its frame x is forward, y left and z up, with the origin at 0.4 lengths
/// from the nose.
struct FishPose {
  Eigen::Affine3f T_world_fish;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< world [m/s]
  float length = 0.0F;                                 ///< [m]
  float beat = 0.0F;                                   ///< phase of the tail [rad]
  std::uint16_t species = 0;
};

/// All fish of a world at any time, in closed form: fish k of a school is at
///   c + (R + a_k(t)) (cos, sin)(w t + b_k) in the plane and z_k(t) above the bed,
/// w = +-speed / R, where a_k and z_k oscillate slowly by a fraction of its length.
class Fish {
 public:
  Fish(const WorldConfig& world, std::uint64_t seed);

  bool empty() const { return all_.empty(); }
  std::vector<FishPose> at(double time_s) const;

 private:
  struct Wave {
    double amplitude, rate, phase;
    double value(double t) const;
    double slope(double t) const;
  };
  struct One {
    Eigen::Vector3d center;  ///< of the circle, at the mean height
    double radius, angle, turn_rate;
    Wave across, up;
    double beat_rate, beat_phase;
    float length;
    std::uint16_t species;
  };

  void add_school(const SchoolConfig& school, double bed, std::uint64_t seed);
  static FishPose pose_of(const One& fish, double time_s);

  std::vector<One> all_;
};

/// Number of vertices that `add_fish` appends.
std::size_t fish_vertex_count();
/// Appends the body of a fish. Its texture coordinates are its own: 0 at the nose to 1 at the end
/// of the tail, -1 at the belly to 1 at the back, and the side, -1 right to 1 left; `detail` is 1
/// on the body and 0 on fins.
void add_fish(TriangleMesh& mesh, const FishPose& pose);
/// Throws InputError if a school is outside of the world.
void check_fish(const WorldConfig& world);

}  // namespace apvi::sim
