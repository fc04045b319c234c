// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "apvi/config/fields.hpp"

/// What a scene places by hand, so that two scenes can differ by it: a dive and a later one.
namespace apvi::sim {

enum class ObjectShape {
  boulder,
  brain_coral,
  branch_coral,
  plate_coral,
  sponge,
  fan_coral,
  weed,
  tire,
  block,
};

std::string_view to_string(ObjectShape shape);

/// An object on the bed. Its mesh depends on its own values and the seed of the scene only, not on
/// the other objects.
struct ObjectConfig {
  std::string name;
  ObjectShape shape = ObjectShape::boulder;
  double x_m = 0.0;
  double y_m = 0.0;
  double size_m = 0.3;
  double turn_deg = 0.0;
  int seed = 1;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    using enum ObjectShape;
    v("name", name, "name in truth/objects.json, different for every object");
    v("shape", shape,
      config::Choices<ObjectShape>{{"boulder", boulder},
                                   {"brain_coral", brain_coral},
                                   {"branch_coral", branch_coral},
                                   {"plate_coral", plate_coral},
                                   {"sponge", sponge},
                                   {"fan_coral", fan_coral},
                                   {"weed", weed},
                                   {"tire", tire},
                                   {"block", block}},
      "what it is");
    v("x_m", x_m, "center, east [m]");
    v("y_m", y_m, "center, north [m]");
    v("size_m", size_m, Range{0.02, 10.0}, "largest of length, width and height [m]");
    v("turn_deg", turn_deg, Range{-360.0, 360.0}, "turn about the vertical [deg]");
    v("seed", seed, Range{0, 2147483647}, "random seed of its form and color");
  }
};

/// A disc in which everything has changed color, as by bleaching or algae.
struct RecoloredDisc {
  std::string name;
  double x_m = 0.0;
  double y_m = 0.0;
  double radius_m = 0.3;
  std::array<double, 3> color{0.85, 0.83, 0.78};
  double amount = 0.8;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("name", name, "name in truth/objects.json, different for every disc and object");
    v("x_m", x_m, "center, east [m]");
    v("y_m", y_m, "center, north [m]");
    v("radius_m", radius_m, Range{0.02, 100.0}, "radius; the outer fifth fades [m]");
    v("color", color, Range{0.0, 1.0}, "albedo that is mixed in: red, green, blue");
    v("amount", amount, Range{0.0, 1.0}, "its part; 1 hides the texture");
  }
};

}  // namespace apvi::sim
