// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "apvi/config/fields.hpp"
#include "sim/world/fish.hpp"
#include "sim/world/mesh.hpp"
#include "sim/world/objects.hpp"

namespace apvi::sim {

enum class WorldKind { seabed, ship, dam };

/// A disc of the seabed without ripples, stones or marine life: a low-texture area.
struct BarePatch {
  double x_m = 0.0;
  double y_m = 0.0;
  double radius_m = 3.0;

  template <typename V>
  void visit(V& v) {
    v("x_m", x_m, "center, east [m]");
    v("y_m", y_m, "center, north [m]");
    v("radius_m", radius_m, config::Range{0.1, 1000.0}, "radius; the edge is soft [m]");
  }
};

/// Worlds are centered on the origin, with the water surface at z = 0.
///  - seabed: bed at about z = -depth_m everywhere, with relief.
///  - ship: wreck of 18 m on the bed, keel along x, upright but for a list, deck about 3.5 m up.
///  - dam: wall in the plane y = 0 that faces -y (water is at y < 0), standing on the bed; the gate
///    is centered on x = -7, the intake grille on x = 7.
struct WorldConfig {
  WorldKind kind = WorldKind::seabed;
  double depth_m = 10.0;
  double size_m = 40.0;
  double resolution_m = 0.06;
  double relief_m = 0.6;
  double ripple_height_m = 0.035;
  double rocks = 1.0;
  double marine_life = 1.0;
  double debris = 1.0;
  double growth = 1.0;
  std::vector<BarePatch> bare_patches{};
  std::vector<ObjectConfig> objects{};
  std::vector<RecoloredDisc> recolored{};
  std::vector<SchoolConfig> fish{};

  template <typename V>
  void visit(V& v) {
    v("kind", kind,
      config::Choices<WorldKind>{
          {"seabed", WorldKind::seabed}, {"ship", WorldKind::ship}, {"dam", WorldKind::dam}},
      "scene");
    v("depth_m", depth_m, config::Range{2.0, 100.0}, "mean depth of the bed [m]");
    v("size_m", size_m, config::Range{10.0, 200.0}, "side of the finely modeled square [m]");
    v("resolution_m", resolution_m, config::Range{0.01, 1.0}, "vertex spacing of the bed [m]");
    v("relief_m", relief_m, config::Range{0.0, 5.0}, "height of the bed's hills, one sigma [m]");
    v("ripple_height_m", ripple_height_m, config::Range{0.0, 0.2}, "height of sand ripples [m]");
    v("rocks", rocks, config::Range{0.0, 5.0},
      "density of boulders and stones, relative to the default");
    v("marine_life", marine_life, config::Range{0.0, 5.0},
      "density of corals, sponges and weed, relative to the default");
    v("debris", debris, config::Range{0.0, 5.0}, "density of litter, relative to the default");
    v("growth", growth, config::Range{0.2, 5.0},
      "size of corals, sponges and weed that grow at random places, relative to the default");
    v("bare_patches", bare_patches, "discs of featureless bed");
    v("objects", objects, "objects placed by hand: name, shape, x_m, y_m, size_m, turn_deg, seed");
    v("recolored", recolored, "discs of another color: name, x_m, y_m, radius_m, color, amount");
    v("fish", fish,
      "schools of fish: count, x_m, y_m, height_m, radius_m, length_m, speed_m_s, seed");
  }
};

/// Builds the world; the same seed gives the same mesh. Objects come last, so that the rest of the
/// mesh is the same with and without them.
TriangleMesh make_world(const WorldConfig& config, std::uint64_t seed);
/// The mesh of every one of `world.objects` in the world.
std::vector<TriangleMesh> make_objects(const WorldConfig& world, std::uint64_t seed);
/// `world.recolored`, as the renderer applies them.
std::vector<Tint> make_tints(const WorldConfig& world);
/// Throws InputError if objects or discs lack a name, share one, or are outside of the world.
void check_objects(const WorldConfig& world);

}  // namespace apvi::sim
