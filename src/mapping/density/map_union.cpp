// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/map_union.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "gaussians/model/point_cloud.hpp"
#include "gaussians/model/rows.hpp"
#include "gaussians/render/render.hpp"
#include "mapping/density/seeds.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kSolidAlpha = 0.9;      // a gap has less, relative to the second map
constexpr double kSameDepth = 0.05;      // relative difference of depths of one surface
constexpr double kInFront = 0.1;         // of the depth: another surface
constexpr float kMinColor = 0.02F;       // darker ones have no ratio
constexpr std::int64_t kSamples = 4096;  // of colors, per view
constexpr std::int64_t kMinSamples = 1000;
constexpr double kMaxLight = 20.0;

struct Drawn {
  Tensor color, depth, alpha;
};

Drawn draw(const gaussians::Gaussians& map, const gaussians::View& view) {
  const gaussians::RenderOutput out = gaussians::render(map, view, {.background = {}});
  return {out.color, out.depth, out.alpha};
}

/// Logarithms [n,3] of the ratio of the second map's colors to the first one's on common surfaces.
Tensor color_ratios(const Drawn& first, const Drawn& second) {
  const Tensor close = (first.depth - second.depth).abs() < kSameDepth * first.depth;
  const Tensor colored = torch::minimum(first.color, second.color).amin(/*dim=*/2) > kMinColor;
  const Tensor common = close & colored & (torch::minimum(first.alpha, second.alpha) > kSolidAlpha);
  const Tensor pixels = common.reshape({-1}).nonzero().squeeze(1);
  const std::int64_t stride = std::max<std::int64_t>(1, pixels.size(0) / kSamples);
  const Tensor some = pixels.slice(0, 0, pixels.size(0), stride);
  const auto at = [&](const Tensor& color) {
    return color.reshape({-1, 3}).index_select(0, some).log();
  };
  return at(second.color) - at(first.color);
}

/// How many views show each Gaussian of the second map, and in how many it fills a gap.
class Votes {
 public:
  explicit Votes(const Tensor& means)
      : means_(means),
        seen_(torch::zeros({means.size(0)}, means.options().dtype(torch::kInt32))),
        gaps_(torch::zeros_like(seen_)) {}

  void add(const gaussians::View& view, const Drawn& first, const Drawn& second) {
    gaussians::View camera = view;
    camera.T_camera_world = view.T_camera_world.to(means_.options());
    const ProjectedPoints points = project(camera, means_);
    const Tensor rows = points.in_view.nonzero().squeeze(1);
    const Tensor pixels = pixel_index(view.intrinsics, points.pixels.index_select(0, rows));
    const auto at = [&](const Tensor& image) {
      return image.reshape({-1}).index_select(0, pixels);
    };
    const Tensor depth = points.depths.index_select(0, rows);
    const Tensor shown = depth < (1.0 + kSameDepth) * at(second.depth);
    const Tensor gap = (at(first.alpha) < kSolidAlpha * at(second.alpha)) |
                       (depth < (1.0 - kInFront) * at(first.depth));
    seen_.index_add_(0, rows, shown.to(torch::kInt32));
    gaps_.index_add_(0, rows, (shown & gap).to(torch::kInt32));
  }

  /// Indices of the Gaussians that fill gaps in most views that show them.
  Tensor filling() const { return (gaps_ * 2 > seen_).nonzero().squeeze(1); }

 private:
  Tensor means_;
  Tensor seen_;
  Tensor gaps_;
};

/// With coefficients of higher degrees, zero.
gaussians::Gaussians with_degree(const gaussians::Gaussians& map, int degree) {
  gaussians::Gaussians out = map;
  const std::int64_t more = gaussians::sh_rest_count(degree) - map.sh_rest.size(1);
  if (more <= 0) return out;
  const Tensor zeros = torch::zeros({map.size(), more, 3}, map.sh_rest.options());
  out.sh_rest = torch::cat({map.sh_rest, zeros}, 1);
  return out;
}

/// The colors divided by `light`.
gaussians::Gaussians relit(const gaussians::Gaussians& map, const Tensor& light) {
  gaussians::Gaussians out = map;
  const Tensor color = gaussians::sh_dc_to_color(map.sh_dc);
  out.sh_dc = gaussians::color_to_sh_dc(color / light);
  out.sh_rest = map.sh_rest / light;
  return out;
}

}  // namespace

MapUnion unite(const gaussians::Gaussians& map, const gaussians::Gaussians& other,
               const std::vector<gaussians::View>& views) {
  const torch::NoGradGuard no_grad;
  Votes votes(other.means);
  std::vector<Tensor> ratios = {torch::empty({0, 3}, map.means.options())};
  for (const gaussians::View& view : views) {
    const Drawn first = draw(map, view);
    const Drawn second = draw(other, view);
    ratios.push_back(color_ratios(first, second));
    votes.add(view, first, second);
  }
  const Tensor all = torch::cat(ratios);
  MapUnion out;
  out.light = all.size(0) < kMinSamples
                  ? torch::ones({3}, map.means.options())
                  : std::get<0>(all.median(0)).exp().clamp(1.0 / kMaxLight, kMaxLight);
  const Tensor rows = votes.filling();
  const int degree = std::max(map.sh_degree(), other.sh_degree());
  out.gaussians =
      gaussians::join(with_degree(map, degree),
                      gaussians::select(with_degree(relit(other, out.light), degree), rows));
  out.added = rows.size(0);
  return out;
}

}  // namespace apvi::mapping
