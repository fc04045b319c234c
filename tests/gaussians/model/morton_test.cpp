// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/model/morton.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cstdint>
#include <limits>

#include "gaussians/render/render.hpp"
#include "gaussians/render/render_scene.hpp"
#include "support/torch_reference.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

/// Interleaved bits of x, y and z.
std::int64_t code_of(std::int64_t x, std::int64_t y, std::int64_t z) {
  std::int64_t code = 0;
  for (int bit = 0; bit < 21; ++bit) {
    code |= (x >> bit & 1) << (3 * bit) | (y >> bit & 1) << (3 * bit + 1) |
            (z >> bit & 1) << (3 * bit + 2);
  }
  return code;
}

TEST(MortonOrder, SortsByMortonCode) {
  constexpr std::int64_t kSide = 1 << 21;  // cells of one meter
  torch::manual_seed(2);
  Tensor cells = torch::randint(0, kSide, {500, 3}, torch::kInt64);
  cells[0] = torch::tensor({0, 0, 0}, torch::kInt64);
  cells[1] = torch::tensor({kSide - 1, kSide - 1, kSide - 1}, torch::kInt64);
  const Tensor order = morton_order(cells.to(torch::kFloat64));
  ASSERT_TRUE(torch::equal(std::get<0>(order.sort()), torch::arange(500)));
  const auto cell = cells.accessor<std::int64_t, 2>();
  const auto place = order.accessor<std::int64_t, 1>();
  const auto code = [&](std::int64_t i) { return code_of(cell[i][0], cell[i][1], cell[i][2]); };
  for (std::int64_t k = 1; k < 500; ++k) EXPECT_LE(code(place[k - 1]), code(place[k]));
}

TEST(MortonOrder, BringsNeighborsTogether) {
  torch::manual_seed(3);
  const Tensor points = torch::rand({4000, 3});
  const auto steps = [](const Tensor& p) {
    return (p.slice(0, 1) - p.slice(0, 0, -1)).norm(2, 1).mean().item<double>();
  };
  EXPECT_LT(steps(points.index_select(0, morton_order(points))), 0.2 * steps(points));
}

TEST(MortonOrder, IsStableAndAcceptsEmptyAndNonFinitePoints) {
  EXPECT_TRUE(torch::equal(morton_order(torch::full({9, 3}, 2.5F)), torch::arange(9)));
  EXPECT_EQ(morton_order(torch::empty({0, 3})).numel(), 0);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  const Tensor odd = torch::tensor({{1.0F, nan, 0.0F}, {-inf, 2.0F, 1.0F}, {0.0F, 0.0F, 0.0F}});
  EXPECT_TRUE(torch::equal(std::get<0>(morton_order(odd).sort()), torch::arange(3)));
  EXPECT_THROW(morton_order(torch::zeros({4, 2})), c10::Error);
}

TEST(MortonOrder, ReorderedMapRendersTheSameImage) {
  const Gaussians before = test::make_gaussians(500, torch::kFloat32);
  const Tensor order = morton_order(before.means);
  ASSERT_FALSE(torch::equal(order, torch::arange(500)));
  const Gaussians after =
      test::map_tensors(before, [&](const Tensor& t) { return t.index_select(0, order); });
  const View view = test::make_view(117, 83);
  EXPECT_TRUE(apvi::test::tensors_near(render(after, view, {}).color,
                                       render(before, view, {}).color, 1e-6));
}

}  // namespace
}  // namespace apvi::gaussians
