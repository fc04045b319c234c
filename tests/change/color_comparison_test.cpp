// SPDX-License-Identifier: BSD-3-Clause
#include "change/color_comparison.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "change/two_dives.hpp"
#include "change/votes.hpp"

namespace apvi::change {
namespace {

constexpr double kBlack = 0.02;

struct Seen {
  std::vector<SurfaceView> views;
  SurfaceCells cells;
};

Seen seen(const Session& session) {
  Seen out;
  for (const gaussians::View& view : session.views)
    out.views.push_back(surface_view(session.map, view, kBlack));
  out.cells = surface_cells(out.views, 0.025);
  return out;
}

ColorComparison compared(const Seen& own, const Session& other) {
  const auto same_frame = [](const Eigen::Vector3d&) { return torch::eye(4, torch::kFloat64); };
  return compare_colors(own.cells, own.views, {other.map, kBlack, same_frame}, [](double) {});
}

torch::Tensor all_rows(const Seen& own) {
  return torch::arange(own.cells.size(), torch::kInt64);
}

/// A floor of patches 8 cm wide with random brightness.
gaussians::Gaussians speckled(std::uint64_t seed) {
  gaussians::Gaussians g = test::floor_at(-2.0);
  const torch::Tensor patch = (g.means / 0.08).floor().to(torch::kInt64) + 50;
  torch::manual_seed(seed);
  const torch::Tensor values = 0.3 + 0.3 * torch::rand({10000, 1});
  const torch::Tensor gray =
      values.index_select(0, patch.select(1, 0) * 100 + patch.select(1, 1)).expand({-1, 3});
  g.sh_dc = gaussians::color_to_sh_dc(gray);
  return g;
}

TEST(ColorComparison, OfOneMapIsEqual) {
  const Session session = test::session(test::floor_at(-2.0));
  const Seen own = seen(session);
  const ColorComparison c = compared(own, session);
  EXPECT_LT((c.own - c.other).abs().max().item<double>(), 1e-4);
  EXPECT_GT(correlation(c, all_rows(own)), 0.999);
}

TEST(ColorComparison, StaysTheSameForASurfaceAtAnotherDepth) {
  // Two centimeters move nothing by a pixel here, but are almost a cell.
  const Seen own = seen(test::session(test::floor_at(-2.0)));
  const ColorComparison c = compared(own, test::session(test::floor_at(-2.02)));
  EXPECT_LT((c.own - c.other).abs().median().item<double>(), 0.02);
  EXPECT_GT(correlation(c, all_rows(own)), 0.8);
}

TEST(ColorComparison, DoesNotCorrelateDifferentTextures) {
  const Seen own = seen(test::session(speckled(1)));
  EXPECT_GT(correlation(compared(own, test::session(speckled(1))), all_rows(own)), 0.99);
  EXPECT_LT(correlation(compared(own, test::session(speckled(2))), all_rows(own)), 0.5);
}

TEST(ColorComparison, IsUnknownWhereTheOtherMapShowsNothing) {
  const Seen own = seen(test::session(test::floor_at(-2.0)));
  Session other = test::session(test::floor_at(-2.0));
  const torch::Tensor west = other.map.gaussians.means.select(1, 0) < 0.0;
  other.map.gaussians.logit_opacities.masked_fill_(west, -10.0F);
  const ColorComparison c = compared(own, other);
  const torch::Tensor x = own.cells.points.select(1, 0);
  EXPECT_EQ(c.views.index({x < -0.1}).max().item<double>(), 0.0);
  EXPECT_GT(c.views.index({(x > 0.1) & (x < 0.8)}).min().item<double>(), 0.0);
}

TEST(EnoughViews, AreAThirdOfTheMedianWithinLimits) {
  const auto of = [](double through, double near) {
    Votes votes;
    votes.through = torch::full({11}, through);
    votes.near = torch::full({11}, near);
    votes.near[0] = votes.through[0] = 0.0;  // not seen
    return enough_views(votes);
  };
  EXPECT_EQ(of(0.0, 4.0), 3.0);
  EXPECT_EQ(of(6.0, 12.0), 6.0);
  EXPECT_EQ(of(10.0, 50.0), 8.0);
}

}  // namespace
}  // namespace apvi::change
