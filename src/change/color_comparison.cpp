// SPDX-License-Identifier: BSD-3-Clause
#include "change/color_comparison.hpp"

#include <torch/torch.h>

#include "mapping/keyframes/keyframe_store.hpp"

namespace apvi::change {
namespace {

using torch::Tensor;

constexpr double kSigmas = 3.0;
constexpr std::int64_t kDetail = 2;  // [cells]

/// Rows and pixels of the cells that are the surface of the view.
Observation shown(const SurfaceCells& cells, const SurfaceView& view) {
  Observation s = observation(view, cells.points);
  const Tensor most = (kSigmas * cells.sigma.index_select(0, s.rows)).clamp_min(cells.cell_m);
  const Tensor kept = (s.distance.abs() <= most).nonzero().squeeze(1);
  for (Tensor* const part : {&s.rows, &s.pixels, &s.points, &s.distance, &s.normals}) {
    *part = part->index_select(0, kept);
  }
  return s;
}

Eigen::Vector3d mean_point(const SurfaceCells& cells, const Tensor& rows) {
  const Tensor mean = cells.points.index_select(0, rows).mean(0).to(torch::kCPU, torch::kFloat64);
  return {mean[0].item<double>(), mean[1].item<double>(), mean[2].item<double>()};
}

Tensor details(const SurfaceCells& cells, const Tensor& color) {
  const Tensor brightness = color.mean(1, true);
  return (brightness - averaged_over_cells(cells.keys, brightness, kDetail)).squeeze(1);
}

gaussians::View moved(gaussians::View view, const OtherMap& other, const Eigen::Vector3d& near) {
  view.T_camera_world = view.T_camera_world.mm(mapping::rigid_inverse(other.motion_at(near)));
  return view;
}

}  // namespace

ColorComparison compare_colors(const SurfaceCells& cells, const std::vector<SurfaceView>& views,
                               const OtherMap& other, const std::function<void(double)>& progress) {
  const torch::NoGradGuard no_grad;
  ColorComparison colors{.own = torch::zeros_like(cells.points),
                         .other = torch::zeros_like(cells.points),
                         .views = torch::zeros_like(cells.points.select(1, 0)),
                         .own_detail = {},
                         .other_detail = {}};
  double done = 0.0;
  for (const SurfaceView& view : views) {
    progress(done++ / static_cast<double>(views.size()));
    const Observation s = shown(cells, view);
    if (s.rows.numel() == 0) continue;
    const ViewLight drawn =
        view_light(other.map, moved(view.view, other, mean_point(cells, s.rows)), other.black);
    const Tensor known = drawn.solid.index_select(0, s.pixels).to(torch::kFloat32);
    const Tensor weight = known.unsqueeze(1);
    colors.views.index_add_(0, s.rows, known);
    colors.own.index_add_(0, s.rows, weight * view.color.index_select(0, s.pixels));
    colors.other.index_add_(0, s.rows, weight * drawn.color.index_select(0, s.pixels));
  }
  const Tensor count = colors.views.clamp_min(1.0).unsqueeze(1);
  colors.own = colors.own / count;
  colors.other = colors.other / count;
  colors.own_detail = details(cells, colors.own);
  colors.other_detail = details(cells, colors.other);
  return colors;
}

double correlation(const ColorComparison& colors, const Tensor& rows) {
  const Tensor known = rows.index({colors.views.index_select(0, rows) > 0.0});
  if (known.numel() < 2) return 0.0;
  const Tensor a = colors.own_detail.index_select(0, known);
  const Tensor b = colors.other_detail.index_select(0, known);
  const double scale = (a.square().sum() * b.square().sum()).sqrt().item<double>();
  return scale > 0.0 ? (a * b).sum().item<double>() / scale : 0.0;
}

}  // namespace apvi::change
