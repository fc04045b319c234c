// SPDX-License-Identifier: BSD-3-Clause
#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "runs/diff/diff_images.hpp"
#include "runs/views/image_files.hpp"
#include "slam/camera_conversion.hpp"
#include "survey/georeference.hpp"
#include "survey/vertical_renderer.hpp"

namespace apvi::runs {
namespace {

using torch::Tensor;

constexpr double kMaxSide_px = 1600.0;
constexpr std::int64_t kHatch_px = 12;  // between hatching lines
constexpr std::array<std::array<float, 3>, 3> kColors = {
    {{0.10F, 0.65F, 0.30F}, {0.84F, 0.15F, 0.16F}, {0.95F, 0.75F, 0.05F}}};

/// Pixels [n] of points [n,3] of the earlier session in a grid, row-major; all are inside.
Tensor pixels_of(const Tensor& points, const SE3& T_crs_map, const survey::GroundGrid& grid) {
  const Tensor T = slam::to_tensor(T_crs_map).slice(0, 0, 3);
  const Tensor p =
      points.to(torch::kCPU, torch::kFloat64).mm(T.slice(1, 0, 3).t()) + T.select(1, 3);
  const auto index = [&](const Tensor& x, std::int64_t size) {
    return (x / grid.resolution_m)
        .floor()
        .clamp(0, static_cast<double>(size - 1))
        .to(torch::kInt64);
  };
  return index(grid.north - p.select(1, 1), grid.height) * grid.width +
         index(p.select(1, 0) - grid.west, grid.width);
}

survey::GroundGrid grid_of(const change::ChangeMap& map, const SE3& T_crs_map) {
  const Tensor T = slam::to_tensor(T_crs_map).slice(0, 0, 3);
  const Tensor p =
      map.points.to(torch::kCPU, torch::kFloat64).mm(T.slice(1, 0, 3).t()) + T.select(1, 3);
  const Tensor low = std::get<0>(p.min(0));
  const Tensor high = std::get<0>(p.max(0));
  const auto at = [](const Tensor& t, int i) { return t[i].item<double>(); };
  const double side = std::max(at(high, 0) - at(low, 0), at(high, 1) - at(low, 1));
  return survey::grid_around({at(low, 0), at(low, 1), at(high, 0), at(high, 1)},
                             std::max(0.5 * map.cell_m, side / kMaxSide_px));
}

/// A mask [H,W] of the points, each as large as a cell.
Tensor mask_of(const Tensor& points, const change::ChangeMap& map, const SE3& T_crs_map,
               const survey::GroundGrid& grid) {
  Tensor mask = torch::zeros({grid.height * grid.width}, torch::kFloat32);
  mask.index_fill_(0, pixels_of(points, T_crs_map, grid), 1.0);
  const auto reach = static_cast<std::int64_t>(std::ceil(0.5 * map.cell_m / grid.resolution_m));
  const Tensor image = mask.view({1, 1, grid.height, grid.width});
  return torch::max_pool2d(image, 2 * reach + 1, 1, reach).view({grid.height, grid.width}) > 0.5;
}

void paint(Tensor& image, const Tensor& mask, const std::array<float, 3>& color, float opacity) {
  const Tensor paint = torch::tensor(at::ArrayRef<float>(color.data(), color.size()));
  const Tensor part = opacity * mask.to(torch::kFloat32).unsqueeze(2);
  image = image * (1.0 - part) + part * paint;
}

/// Diagonal lines [H,W].
Tensor hatching(const survey::GroundGrid& grid) {
  return (torch::arange(grid.width) + torch::arange(grid.height).unsqueeze(1)) % kHatch_px < 3;
}

Tensor change_image(const Tensor& after, const change::ChangeMap& map, const SE3& T_crs_map,
                    const survey::GroundGrid& grid) {
  Tensor image = (0.35 + 0.6 * after.mean(2, true)).expand({-1, -1, 3}).clone();
  const auto cells = [&](const Tensor& which) {
    return mask_of(map.points.index({which}), map, T_crs_map, grid);
  };
  const Tensor both = cells(map.seen == static_cast<int>(change::Seen::both));
  const Tensor any = cells(torch::ones_like(map.seen, torch::kBool));
  paint(image, ~any, {1.0F, 1.0F, 1.0F}, 1.0F);
  paint(image, any & ~both, {0.80F, 0.82F, 0.85F}, 0.7F);
  paint(image, any & ~both & hatching(grid), {0.40F, 0.45F, 0.50F}, 0.8F);
  for (const change::Change& change : map.changes) {
    paint(image, mask_of(change.points, map, T_crs_map, grid),
          kColors.at(static_cast<std::size_t>(change.kind)), 0.85F);
  }
  return image;
}

/// The map from above; white where it shows nothing.
template <typename Colors>
Tensor plan(const mapping::Map& map, const SE3& T_crs_map, const survey::GroundGrid& grid,
            const Colors& colors) {
  const survey::GroundImage image = survey::VerticalRenderer({map, T_crs_map}).render(grid);
  return torch::where(image.known.unsqueeze(2), colors(image.color), torch::ones_like(image.color))
      .to(torch::kCPU);
}

}  // namespace

double write_plan_images(const std::filesystem::path& folder, const DiffSessions& sessions,
                         const change::ChangeMap& map, const DiffColors& colors) {
  const SE3 T_crs_map = survey::georeference({}, sessions.z_down).T_crs_world;
  const SE3 T_crs_after =
      T_crs_map * slam::to_se3(map.registration.motion_at(Eigen::Vector3d(
                      map.points.mean(0)[0].item<double>(), map.points.mean(0)[1].item<double>(),
                      map.points.mean(0)[2].item<double>())));
  const survey::GroundGrid grid = grid_of(map, T_crs_map);
  const Tensor before = plan(sessions.before.map, T_crs_map, grid,
                             [&](const Tensor& light) { return colors.before(light); });
  const Tensor after = plan(sessions.after.map, T_crs_after, grid,
                            [&](const Tensor& light) { return colors.after(light); });
  write_png(folder / "before.png", before);
  write_png(folder / "after.png", after);
  write_png(folder / "changes.png", change_image(after, map, T_crs_map, grid));
  return grid.resolution_m;
}

}  // namespace apvi::runs
