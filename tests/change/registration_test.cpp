// SPDX-License-Identifier: BSD-3-Clause
#include "change/registration.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "change/two_dives.hpp"

namespace apvi::change {
namespace {

TEST(DeformationField, AddsTheDisplacementThatItsEquationsAskFor) {
  const torch::Tensor points = test::lattice({0.0, 0.0, 0.0}, 2, 4.0, 4.0, 0.1).to(torch::kFloat32);
  const torch::Tensor x = points.select(1, 0);
  const torch::Tensor wanted = torch::stack({0.02 * (0.5 * x).sin(), 0.005 * x, 0.01 + 0.0 * x}, 1);
  const torch::Tensor H = 1e4 * torch::eye(3).expand({points.size(0), 3, 3});
  DeformationField deformation(points, 1.0);
  deformation.update(points, {H, 1e4 * wanted}, 0.01);
  EXPECT_LT((deformation(points) - wanted).norm(2, 1).max().item<double>(), 2.5e-3);
}

TEST(DeformationField, WithoutEvidenceItStaysAtItsNeighbors) {
  const torch::Tensor points = test::lattice({0.0, 0.0, 0.0}, 2, 4.0, 4.0, 0.1).to(torch::kFloat32);
  const torch::Tensor known = (points.select(1, 0) < 0.0).to(torch::kFloat32);
  const torch::Tensor H = 1e4 * known.view({-1, 1, 1}) * torch::eye(3);
  const torch::Tensor g = 1e4 * known.unsqueeze(1) * torch::tensor({0.03F, 0.0F, -0.02F});
  DeformationField deformation(points, 1.0);
  deformation.update(points, {H, g}, 0.01);
  const torch::Tensor error = deformation(points) - torch::tensor({0.03F, 0.0F, -0.02F});
  EXPECT_LT(error.abs().max().item<double>(), 1e-3);
}

/// Surface views and cells of a session over a floor, moved as a whole.
struct Moved {
  std::vector<SurfaceView> views;
  SurfaceCells cells;

  explicit Moved(const torch::Tensor& T_world_moved) {
    const gaussians::Gaussians floor =
        test::joined(test::floor_at(-2.0), test::box_on(-2.0, 0.3, 0.3, 0.3));
    const mapping::Map map{.gaussians = floor, .medium = {}};
    for (const gaussians::View& view : test::views_over(-1.0, 1.0)) {
      SurfaceView drawn = surface_view(map, view, 0.02);
      drawn.view.T_camera_world = view.T_camera_world.mm(T_world_moved);
      views.push_back(drawn);
    }
    cells = surface_cells(views, 0.025);
  }
};

TEST(Align, ASmallRigidMotionIsFound) {
  const Moved before(torch::eye(4, torch::kFloat64));
  const double angle = 0.012;
  torch::Tensor T = torch::eye(4, torch::kFloat64);
  T[0][0] = T[1][1] = std::cos(angle);
  T[1][0] = std::sin(angle);
  T[0][1] = -std::sin(angle);
  T[0][3] = 0.03;
  T[1][3] = -0.025;
  T[2][3] = 0.02;
  const Moved after(T);
  const Registration found =
      align(after.cells, before.views, before.cells.detail, [](double, std::string_view) {});
  const torch::Tensor p = after.cells.points;
  const torch::Tensor Tf = T.to(torch::kFloat32);
  const torch::Tensor wanted =
      p.mm(Tf.slice(0, 0, 3).slice(1, 0, 3).t()) + Tf.slice(0, 0, 3).select(1, 3);
  const torch::Tensor error = (found.to_before(p) - wanted).norm(2, 1);
  EXPECT_LT(error.median().item<double>(), 4e-3);
  EXPECT_LT((found.to_after(found.to_before(p)) - p).norm(2, 1).max().item<double>(), 1e-3);
}

}  // namespace
}  // namespace apvi::change
