// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "viewer/scene.hpp"

namespace apvi::viewer {

/// A Gaussian as the static page stores it: 36 bytes, little endian.
struct Splat {
  std::array<float, 3> mean{};        ///< [m]
  std::array<float, 3> sigmas{};      ///< standard deviations along its axes [m]
  std::array<float, 4> quaternion{};  ///< unit, w x y z; stored in 8 bits each
  std::array<float, 3> color{};       ///< RGB of SH degree 0, 0 to 4; stored in 16 bits each
  float opacity = 0.0F;               ///< stored in 16 bits
};

/// The medium and the display of a map.
struct StaticMap {
  struct Water {
    std::array<double, 3> beta_d{}, beta_b{}, b_inf{};
  };
  std::vector<Splat> splats;
  std::optional<Water> water;
  std::array<double, 3> gains = {1.0, 1.0, 1.0};  ///< of restored images, RGB
  bool antialiased = false;                       ///< see gaussians::RenderOptions
};

/// The page that shows a map without a server, see page/splats.js.
std::string export_page(const SceneDescription& description, const StaticMap& map);

}  // namespace apvi::viewer
