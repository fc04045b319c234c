// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/sim/mesh.hpp"

namespace apvi::sim {

enum class WorldKind { seabed, ship, dam };

/// A disc of the bed without ripples, stones or life: a low-texture stretch.
struct BarePatch {
  double x_m = 0.0;
  double y_m = 0.0;
  double radius_m = 3.0;

  template <typename V>
  void visit(V& v) {
    v("x_m", x_m, "centre, east [m]");
    v("y_m", y_m, "centre, north [m]");
    v("radius_m", radius_m, config::Range{0.1, 1000.0}, "radius; the edge is soft [m]");
  }
};

/// Worlds are centred on the origin, surface at z = 0.
///  - seabed: bed at about z = -depth_m everywhere, relief around it.
///  - ship: wreck of 18 m on the bed, keel along x, upright but for a list, deck about 3.5 m up.
///  - dam: wall in the plane y = 0 that faces -y (water is at y < 0), its foot at the bed; the gate
///    is centred on x = -7, the intake grille on x = 7.
struct WorldConfig {
  WorldKind kind = WorldKind::seabed;
  double depth_m = 10.0;
  double size_m = 40.0;
  double resolution_m = 0.06;
  double relief_m = 0.6;
  double ripple_height_m = 0.035;
  double rocks = 1.0;
  double life = 1.0;
  double debris = 1.0;
  std::vector<BarePatch> bare{};

  template <typename V>
  void visit(V& v) {
    v("kind", kind,
      config::Choices<WorldKind>{
          {"seabed", WorldKind::seabed}, {"ship", WorldKind::ship}, {"dam", WorldKind::dam}},
      "what there is to see");
    v("depth_m", depth_m, config::Range{2.0, 100.0}, "mean depth of the bed [m]");
    v("size_m", size_m, config::Range{10.0, 200.0}, "side of the finely modelled square [m]");
    v("resolution_m", resolution_m, config::Range{0.01, 1.0}, "vertex spacing of the bed [m]");
    v("relief_m", relief_m, config::Range{0.0, 5.0}, "height of the bed's hills, one sigma [m]");
    v("ripple_height_m", ripple_height_m, config::Range{0.0, 0.2}, "height of sand ripples [m]");
    v("rocks", rocks, config::Range{0.0, 5.0}, "density of boulders and stones, 1 is usual");
    v("life", life, config::Range{0.0, 5.0}, "density of corals, sponges and weed, 1 is usual");
    v("debris", debris, config::Range{0.0, 5.0}, "density of things people lost, 1 is usual");
    v("bare", bare, "discs of featureless bed");
  }
};

/// Builds the world; the same seed gives the same mesh.
TriangleMesh make_world(const WorldConfig& config, std::uint64_t seed);

}  // namespace apvi::sim
