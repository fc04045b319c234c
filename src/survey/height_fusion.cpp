// SPDX-License-Identifier: BSD-3-Clause
#include "survey/height_fusion.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "survey/crs_points.hpp"
#include "survey/mesh_views.hpp"
#include "survey/projection.hpp"

namespace apvi::survey {
namespace {

using torch::Tensor;

constexpr std::array kTruncations = {0.25, 0.1, 0.05, 0.025, 0.025};
constexpr int kMaxWidth = 640;  // [px]
constexpr std::size_t kMaxBytes = std::size_t{256} << 20U;
constexpr double kMinViews = 3.0;
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
constexpr std::int64_t kProbe = 16;  // every so many pixels decide which views see a tile

/// Points of a tile in the frame of the map, and how heights move them there.
struct Columns {
  Tensor foot;    ///< [n,3] float32 at height zero above the anchor [m]
  Tensor up;      ///< [3]
  Tensor height;  ///< [n] above the anchor [m]

  Tensor points() const { return foot + height.unsqueeze(1) * up; }
};

/// The camera's position in the frame of the map [3].
Tensor center_of(const gaussians::View& view, const torch::TensorOptions& options) {
  const Tensor T = view.T_camera_world.slice(0, 0, 3);
  return -T.slice(1, 0, 3).t().mv(T.select(1, 3)).to(options);
}

gaussians::View reduced(gaussians::View view) {
  const gaussians::Intrinsics& k = view.intrinsics;
  if (k.width <= kMaxWidth) return view;
  const double scale = static_cast<double>(kMaxWidth) / k.width;
  view.intrinsics =
      k.scaled(kMaxWidth, std::max(1, static_cast<int>(std::lround(scale * k.height))));
  return view;
}

Columns columns_of(const SurveyMap& map, const Tensor& heights, const GroundGrid& tile,
                   const Tensor& known) {
  const SE3 T_map_crs = map.T_crs_map.inverse();
  const Eigen::Vector3d anchor = map.T_crs_map.translation;
  const auto options = heights.options();
  const Tensor x =
      torch::arange(tile.width, options) + 0.5 + (tile.west - anchor.x()) / tile.resolution_m;
  const Tensor y =
      (tile.north - anchor.y()) / tile.resolution_m - torch::arange(tile.height, options) - 0.5;
  const Tensor east = (tile.resolution_m * x).expand_as(heights).index({known});
  const Tensor north = (tile.resolution_m * y).unsqueeze(1).expand_as(heights).index({known});
  const Tensor foot = torch::stack({east, north, torch::zeros_like(east)}, 1).mm(crs_rotation(map));
  const Eigen::Vector3d up = T_map_crs.rotation * Eigen::Vector3d::UnitZ();
  return {foot.to(torch::kFloat32),
          torch::tensor({up.x(), up.y(), up.z()}, options).to(torch::kFloat32),
          (heights.index({known}) - anchor.z()).to(torch::kFloat32)};
}

/// A view with its depth image, flat.
struct DepthImage {
  const SurveyView* view;
  Tensor depth;  ///< [H * W]; 0 where unknown
};

std::vector<DepthImage> images_of(const SurveyMap& map, const std::vector<SurveyView>& views,
                                  const Tensor& probes) {
  std::vector<const SurveyView*> seeing;
  std::size_t bytes = 1;
  for (const SurveyView& view : views) {
    if (!project(view.camera, probes).inside.any().item<bool>()) continue;
    seeing.push_back(&view);
    const gaussians::Intrinsics& k = view.camera.intrinsics;
    bytes += sizeof(float) * static_cast<std::size_t>(k.width) * static_cast<std::size_t>(k.height);
  }
  const std::size_t stride = (bytes + kMaxBytes - 1) / kMaxBytes;
  std::vector<DepthImage> images;
  for (std::size_t i = 0; i < seeing.size(); i += stride) {
    images.push_back({seeing[i], reliable_depth(map.map, *seeing[i]).flatten()});
  }
  return images;
}

/// One iteration; returns how many views saw each point [n].
Tensor move(Columns& columns, const std::vector<DepthImage>& images, double truncation) {
  const Tensor points = columns.points();
  Tensor sum = torch::zeros_like(columns.height);
  Tensor count = torch::zeros_like(columns.height);
  for (const DepthImage& image : images) {
    const Projection at = project(image.view->camera, points);
    const Tensor seen = image.depth.index_select(0, at.pixel);
    const Tensor above = (center_of(image.view->camera, points.options()) - points).mv(columns.up);
    const Tensor drop = (seen - at.depth) * above / at.depth;
    const Tensor most = truncation * above;
    const Tensor valid = at.inside & (seen > 0.0) & (above > 0.0) & (drop > -most);
    sum += torch::where(valid, torch::minimum(drop, most), torch::zeros_like(drop));
    count += valid;
  }
  columns.height -= sum / count.clamp_min(1.0);
  return count;
}

}  // namespace

HeightFusion::HeightFusion(const SurveyMap& map, std::vector<SurveyView> views)
    : map_(&map), views_(std::move(views)) {
  for (SurveyView& view : views_) view.camera = reduced(view.camera);
}

Tensor HeightFusion::operator()(const Tensor& heights, const GroundGrid& tile) const {
  const torch::NoGradGuard no_grad;
  const Tensor known = ~heights.isnan();
  Columns columns = columns_of(*map_, heights, tile, known);
  if (columns.height.numel() == 0) return heights;
  const Tensor points = columns.points();
  const auto images = images_of(*map_, views_, points.slice(0, 0, points.size(0), kProbe));
  Tensor count;
  for (const double truncation : kTruncations) count = move(columns, images, truncation);
  const auto enough = std::min(kMinViews, static_cast<double>(views_.size()));
  Tensor refined = heights.clone();
  refined.index_put_({known}, (columns.height.to(torch::kFloat64) + map_->T_crs_map.translation.z())
                                  .masked_fill(count < enough, kUnknown));
  return refined;
}

}  // namespace apvi::survey
