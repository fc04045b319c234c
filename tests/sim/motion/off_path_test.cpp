// SPDX-License-Identifier: BSD-3-Clause
#include "sim/motion/off_path.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace apvi::sim {
namespace {

using Eigen::Vector3d;

/// Walls across x of a camera at the origin that looks along z, 40 m large.
RayCaster walls_at(const std::vector<float>& places) {
  TriangleMesh mesh;
  for (const float x : places) {
    const std::uint32_t first = static_cast<std::uint32_t>(mesh.vertices.size());
    mesh.add_vertex({x, -20, -20});
    mesh.add_vertex({x, 20, -20});
    mesh.add_vertex({x, 20, 20});
    mesh.add_vertex({x, -20, 20});
    mesh.add_quad(first, first + 1, first + 2, first + 3, Material::plain);
  }
  return RayCaster(mesh);
}

TEST(OffPathView, IsAsideAndTurnedBack) {
  const auto view =
      off_path_view(SE3::identity(), {.aside_m = 1.0, .turn_deg = 30.0}, false, walls_at({9.0F}));
  ASSERT_TRUE(view);
  EXPECT_TRUE(view->translation.isApprox(Vector3d(1.0, 0.0, 0.0)));
  const Vector3d ahead = view->rotation * Vector3d::UnitZ();
  EXPECT_TRUE(ahead.isApprox(Vector3d(-0.5, 0.0, std::sqrt(0.75))));
}

TEST(OffPathView, GoesToTheOtherSideOfAWall) {
  const auto view = off_path_view(SE3::identity(), {}, false, walls_at({1.1F}));
  ASSERT_TRUE(view);
  EXPECT_LT(view->translation.x(), 0.0);
  const Vector3d ahead = view->rotation * Vector3d::UnitZ();
  EXPECT_GT(ahead.x(), 0.0);
}

TEST(OffPathView, IsMissingWithoutRoomOnEitherSide) {
  EXPECT_FALSE(off_path_view(SE3::identity(), {}, false, walls_at({1.1F, -0.8F})));
}

}  // namespace
}  // namespace apvi::sim
