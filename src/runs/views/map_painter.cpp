// SPDX-License-Identifier: BSD-3-Clause
#include "runs/views/map_painter.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <utility>

#include "mapping/surface_depth.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::runs {
namespace {

using torch::Tensor;

constexpr double kOpaque = 0.5;               // below it, a pixel shows no surface
constexpr std::int64_t kExtentSample = 5000;  // Gaussians that show how large a map is

gaussians::View to_view(const viewer::Viewpoint& v) {
  const double focal = v.focal * v.height;
  gaussians::View view;
  view.intrinsics = {.fx = focal,
                     .fy = focal,
                     .cx = 0.5 * v.width,
                     .cy = 0.5 * v.height,
                     .width = v.width,
                     .height = v.height};
  view.T_camera_world = slam::to_tensor(v.T_world_camera.inverse());
  return view;
}

cv::Mat to_mat(const Tensor& image) {
  const Tensor values = image.to(torch::kCPU, torch::kFloat32).contiguous();
  return cv::Mat(static_cast<int>(values.size(0)), static_cast<int>(values.size(1)), CV_32F,
                 values.data_ptr())
      .clone();
}

// The factors of restored images, less of them the more water there is.
mapping::DisplayExposure partly(const mapping::DisplayExposure& exposure, double part) {
  mapping::DisplayExposure out = exposure;
  out.brightness = std::pow(exposure.brightness, part);
  for (std::size_t i = 0; i < out.balance.size(); ++i) {
    out.balance.at(i) = std::pow(exposure.balance.at(i), part);
  }
  return out;
}

// At a fraction of the values, in their order.
double value_at(const Tensor& values, double fraction) {
  const Tensor sorted = std::get<0>(values.sort());
  const auto last = static_cast<double>(values.size(0) - 1);
  return sorted[static_cast<std::int64_t>(fraction * last)].item<double>();
}

}  // namespace

void MapPainter::set_map(mapping::Map map, std::vector<gaussians::View> views, bool with_levels) {
  map_ = std::move(map);
  section_.clear();
  views_ = std::move(views);
  levels_.reset();
  coming_levels_ = {};
  if (!with_levels) return;
  coming_levels_ = std::async(std::launch::async,
                              [all = map_.gaussians] { return gaussians::DetailLevels(all); });
}

mapping::MapRendering MapPainter::rendering(const gaussians::View& camera,
                                            const viewer::View& view) {
  if (coming_levels_.valid() &&
      coming_levels_.wait_for(std::chrono::seconds(0)) == std::future_status::ready) {
    levels_ = coming_levels_.get();
  }
  const std::optional<viewer::Section>& section = view.viewpoint.section;
  if (section || !levels_ || view.detail_px <= 0.0) {
    return mapping::render_map(section_.of(map_, section), camera);
  }
  mapping::Map drawn = map_;
  drawn.gaussians = levels_->select(camera, view.detail_px);
  return mapping::render_map(drawn, camera);
}

std::optional<viewer::Rendering> MapPainter::render(const viewer::View& view) {
  if (empty()) return std::nullopt;
  const torch::NoGradGuard no_grad;
  const gaussians::View camera = to_view(view.viewpoint);
  const mapping::MapRendering drawn = rendering(camera, view);
  viewer::Rendering out;
  out.depth = to_mat(drawn.depth);
  out.alpha = to_mat(drawn.alpha);
  const bool colored = view.layer == viewer::Layer::seen || view.layer == viewer::Layer::restored;
  if (colored) out.color = slam::to_image(color(view, camera, drawn));
  return out;
}

// Between the image with and without the medium, exposure and compression change smoothly.
Tensor MapPainter::color(const viewer::View& view, const gaussians::View& camera,
                         const mapping::MapRendering& rendering) {
  const double water = view.layer == viewer::Layer::restored ? 0.0 : view.water;
  const Tensor image = mapping::with_water(map_, camera.intrinsics, rendering, water);
  const gaussians::ToneCurve& curve = map_.tone_curve;
  if (water >= 1.0 || !map_.medium) return curve.encode(image);
  const mapping::DisplayExposure factors = partly(exposure(camera), 1.0 - water);
  const Tensor compressed = mapping::displayed(image, factors, curve);
  const Tensor plain = curve.encode(mapping::exposed(image, factors)).clamp(0.0, 1.0);
  return torch::lerp(compressed, plain, water);
}

mapping::DisplayExposure MapPainter::exposure(const gaussians::View& camera) {
  if (!exposure_) {
    exposure_ = mapping::display_exposure(map_, views_.empty() ? std::vector{camera} : views_);
  }
  return *exposure_;
}

std::optional<double> MapPainter::depth(const viewer::Viewpoint& viewpoint, int column,
                                        int row) const {
  if (empty()) return std::nullopt;
  const torch::NoGradGuard no_grad;
  const gaussians::View camera = to_view(viewpoint);
  const mapping::Map& shown = section_.of(map_, viewpoint.section);
  const mapping::MapRendering r = mapping::render_map(shown, camera);
  if (r.alpha[row][column].item<double>() < kOpaque) return std::nullopt;
  const double depth =
      mapping::surface_depth(shown, camera, r.depth, r.alpha)[row][column].item<double>();
  if (depth > 0.0) return depth;
  return std::nullopt;
}

MapExtent extent_of(const mapping::Map& map) {
  MapExtent out{.gaussians = map.gaussians.size(), .medium = map.medium.has_value()};
  if (out.gaussians == 0) return out;
  const torch::NoGradGuard no_grad;
  const std::int64_t stride = std::max<std::int64_t>(1, out.gaussians / kExtentSample);
  const Tensor means = map.gaussians.means.detach()
                           .slice(0, 0, c10::nullopt, stride)
                           .to(torch::kCPU, torch::kFloat64);
  for (std::int64_t i = 0; i < 3; ++i) out.center[i] = value_at(means.select(1, i), 0.5);
  const Tensor center =
      torch::tensor({out.center.x(), out.center.y(), out.center.z()}, torch::kFloat64);
  out.radius_m = std::max(1e-3, value_at((means - center).norm(2, 1), 0.8));
  return out;
}

}  // namespace apvi::runs
