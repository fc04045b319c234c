// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/spectral_renderer.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "sim/render/frame_poses.hpp"
#include "sim/render/snow.hpp"
#include "sim/spectral/effective_medium.hpp"
#include "sim/spectral/exposure_track.hpp"
#include "sim/spectral/forward_blur.hpp"
#include "sim/spectral/phase_function.hpp"
#include "sim/world/moving_scene.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr int kTile = 16;  // pixels per side; a tile has kBatch pixels
constexpr std::size_t kGreenBand = 7;

// Every so many pixels of a lens, as a lens of a small image.
Lens thinned(const Lens& lens, int width, int height) {
  Lens thin{.width = width, .height = height, .rays = {}, .origins = {}, .angle = {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const std::size_t i = lens.index((2 * x + 1) * lens.width / (2 * width),
                                       (2 * y + 1) * lens.height / (2 * height));
      thin.rays.push_back(lens.rays[i]);
      if (!lens.origins.empty()) thin.origins.push_back(lens.origins[i]);
      thin.angle.push_back(lens.angle[i] * static_cast<float>(lens.width) /
                           static_cast<float>(width));
    }
  }
  return thin;
}

// A dense cloud spreads all light anyway.
void hide_in_silt(const SiltCloud& silt, TileRays& rays, Lanes (&soft)[3]) {
  for (int c = 0; c < 3; ++c) {
    for (int i = 0; i < kBatch; ++i) rays.observed[c][i] += soft[c][i];
    soft[c].fill(0.0F);
  }
  add_silt(silt, rays);
}

Vector3d to_rgb(const cv::Scalar& bgr) {
  return {bgr[2], bgr[1], bgr[0]};
}

Vector3d to_rgb(const cv::Vec3f& bgr) {
  return {static_cast<double>(bgr[2]), static_cast<double>(bgr[1]), static_cast<double>(bgr[0])};
}

}  // namespace

/// Images in raw values, BGR.
struct SpectralRenderer::Layers {
  cv::Mat observed, blurred;  ///< CV_32FC3: sharp light with the backscatter; light for the blur
  cv::Mat clear, direct;  ///< CV_32FC3, mid-exposure: without water; without backscatter and blur
  cv::Mat range, depth;   ///< CV_32F
  cv::Mat nearest;        ///< CV_32F: like `range`, to what moves where that is nearer
  cv::Mat moving;         ///< CV_8U, see RenderedFrame

  explicit Layers(const Lens& lens) {
    const cv::Size size(lens.width, lens.height);
    for (cv::Mat* layer : {&observed, &blurred, &clear, &direct})
      *layer = cv::Mat::zeros(size, CV_32FC3);
    for (cv::Mat* layer : {&range, &depth, &nearest}) *layer = cv::Mat::zeros(size, CV_32F);
    moving = cv::Mat::zeros(size, CV_8U);
  }
  void add_exposed(float weight, const cv::Rect& tile, const TileRays& rays,
                   const Lanes (&soft)[3]);
  void store_middle(const Lens& lens, const cv::Rect& tile, const TileRays& rays,
                    const Lanes (&soft)[3]);
  void store_nearest(const cv::Rect& tile, const TileRays& rays);
};

void SpectralRenderer::Layers::add_exposed(float weight, const cv::Rect& tile, const TileRays& rays,
                                           const Lanes (&soft)[3]) {
  for (int i = 0; i < tile.area(); ++i) {
    const cv::Point at(tile.x + i % tile.width, tile.y + i / tile.width);
    for (int c = 0; c < 3; ++c) {
      observed.at<cv::Vec3f>(at)[c] += weight * rays.observed[2 - c][i];
      blurred.at<cv::Vec3f>(at)[c] += weight * soft[2 - c][i];
    }
    auto& mark = moving.at<std::uint8_t>(at);
    mark = std::max(mark, rays.moving[static_cast<std::size_t>(i)]);
  }
}

// Before the backscatter and what moves are added.
void SpectralRenderer::Layers::store_middle(const Lens& lens, const cv::Rect& tile,
                                            const TileRays& rays, const Lanes (&soft)[3]) {
  for (int i = 0; i < tile.area(); ++i) {
    const cv::Point at(tile.x + i % tile.width, tile.y + i / tile.width);
    for (int c = 0; c < 3; ++c) {
      clear.at<cv::Vec3f>(at)[c] = rays.clear[2 - c][i];
      direct.at<cv::Vec3f>(at)[c] = rays.observed[2 - c][i] + soft[2 - c][i];
    }
    const float along = rays.rays.range[static_cast<std::size_t>(i)];
    if (along < 0.0F) continue;
    const std::size_t pixel = lens.index(at.x, at.y);
    const float start = lens.origins.empty() ? 0.0F : lens.origins[pixel].z();
    range.at<float>(at) = along;
    depth.at<float>(at) = start + along * lens.rays[pixel].z();
  }
}

/// What one frame is rendered with.
struct SpectralRenderer::View {
  FramePoses poses;
  SE3 T_world_camera;  ///< at mid-exposure
  SpectralLight light;
  const MovingScene* moving = nullptr;  ///< null: nothing moves
};

void SpectralRenderer::Layers::store_nearest(const cv::Rect& tile, const TileRays& rays) {
  for (int i = 0; i < tile.area(); ++i) {
    nearest.at<float>(tile.y + i / tile.width, tile.x + i % tile.width) =
        std::max(0.0F, rays.rays.range[static_cast<std::size_t>(i)]);
  }
}

void SpectralRenderer::add_moving_shadows(const View& view, TileSurface& surface, TileRays& rays) {
  const auto shadowed = cast_shadows(
      *view.moving, view.light.state.sun_direction,
      {.p = surface.p, .nx = surface.nx, .ny = surface.ny, .nz = surface.nz, .sun = surface.sun});
  for (std::size_t i = 0; i < rays.rays.size(); ++i) {
    if (shadowed[i] && rays.rays.range[i] >= 0.0F) rays.moving[i] = kMovingShadow;
  }
}

// Replaces what the rays see by what moves in front of it.
void SpectralRenderer::draw_moving(const View& view, TileRays& rays, Lanes (&soft)[3]) {
  TileRays front;
  if (!cast_in_front(*view.moving, rays, front)) return;
  TileSurface surface;
  Lanes front_soft[3];  // NOLINT(cppcoreguidelines-pro-type-member-init): filled below
  gather_surfaces(view.moving->mesh, view.moving->baked, front, surface);
  shade_spectral(view.light, surface, front, front_soft);
  for (std::size_t i = 0; i < front.rays.size(); ++i) {
    if (front.rays.range[i] < 0.0F) continue;
    const auto lane = static_cast<int>(i);
    for (std::size_t c = 0; c < 3; ++c) {
      rays.observed[c][lane] = front.observed[c][lane];
      soft[c][lane] = front_soft[c][lane];
    }
    rays.rays.range[i] = front.rays.range[i];
    rays.moving[i] = kMovingBody;
  }
}

SpectralRenderer::SpectralRenderer(const RenderScene& scene)
    : scene_(scene),
      sea_(scene.config.water, scene.config.light, scene.config.spectral),
      pipeline_(scene.config.camera, scene.config.spectral, sea_.sensor(), scene.lens),
      meter_lens_(
          thinned(scene.lens, std::min(32, scene.lens.width), std::min(24, scene.lens.height))) {}

Vector3d SpectralRenderer::fixed_white_balance() const {
  if (const auto& given = scene_.config.camera.white_balance)
    return {(*given)[0], (*given)[1], (*given)[2]};
  if (scene_.config.spectral.white_balance != WhiteBalance::preset) return Vector3d::Ones();
  const Vector3d card = sea_.gray_card().cwiseMax(1e-9);
  return (card.y() / card.array()).min(8.0);
}

SpectralRenderer::View SpectralRenderer::view_of(const ImageRequest& request) const {
  View view{.poses = frame_poses(request, {scene_.camera, scene_.config.camera, scene_.world}),
            .T_world_camera = request.T_world_camera(request.stamp),
            .light = {},
            .moving = request.moving.get()};
  view.light.sea = &sea_;
  view.light.state = sea_.state(request.disturbance, std::fmod(request.stamp.seconds(), 36000.0));
  view.light.lamps = sea_.lamp_poses(view.T_world_camera);
  for (const LampPose& lamp : view.light.lamps) view.light.shadows.emplace_back(lamp, scene_.world);
  return view;
}

void SpectralRenderer::render_tile(const View& view, const Lens& lens,
                                   const BackscatterGrid& scattered, int sample,
                                   const cv::Rect& tile, Layers& layers) const {
  TileRays rays;
  TileSurface surface;
  Lanes soft[3];  // NOLINT(cppcoreguidelines-pro-type-member-init): filled below
  fill_rays(lens, view.poses, sample, tile, rays);
  scene_.world.cast(rays.rays);
  gather_surfaces(scene_.mesh, scene_.baked, rays, surface);
  if (view.moving != nullptr) add_moving_shadows(view, surface, rays);
  shade_spectral(view.light, surface, rays, soft);
  const bool middle = 2 * sample + 1 == view.poses.samples;
  if (middle) layers.store_middle(lens, tile, rays, soft);
  if (view.moving != nullptr) draw_moving(view, rays, soft);
  if (middle) layers.store_nearest(tile, rays);
  add_sky(view.light, rays);
  scattered.add_to(tile, rays);
  if (view.light.state.silt.density > 0.0) hide_in_silt(view.light.state.silt, rays, soft);
  layers.add_exposed(1.0F / static_cast<float>(view.poses.samples), tile, rays, soft);
}

SpectralRenderer::Layers SpectralRenderer::render_layers(const View& view, const Lens& lens,
                                                         const BackscatterGrid& scattered,
                                                         int threads) const {
  Layers layers(lens);
  const int columns = (lens.width + kTile - 1) / kTile;
  const int rows = (lens.height + kTile - 1) / kTile;
  parallel_for(columns * rows, threads, [&](int i) {
    const cv::Rect tile(i % columns * kTile, i / columns * kTile, kTile, kTile);
    const cv::Rect inside = tile & cv::Rect(0, 0, lens.width, lens.height);
    for (int k = 0; k < view.poses.samples; ++k)
      render_tile(view, lens, scattered, k, inside, layers);
  });
  return layers;
}

BackscatterGrid SpectralRenderer::backscatter_of(const View& view, const Lens& lens,
                                                 int step) const {
  return {lens, step, view.T_world_camera, sea_, view.light.state, view.light.lamps, scene_.world};
}

void SpectralRenderer::add_particles(const ImageRequest& request, const View& view,
                                     const BackscatterGrid& scattered, Layers& layers) const {
  const SnowColor color = [&](const Vector3d& p_world, const Vector3d& p_camera,
                              double brightness) -> Vector3d {
    const double range = p_camera.norm();
    Vector3d lit = brightness *
                   light_on_particle(view.light, p_world.cast<float>(), static_cast<float>(range));
    const auto pixel = scene_.camera.project(p_camera);
    if (!pixel || !scene_.camera.in_image(*pixel, 0.0)) return lit;
    return lit + scattered
                     .at(static_cast<int>(pixel->x()), static_cast<int>(pixel->y()),
                         static_cast<float>(range))
                     .cast<double>();
  };
  const Duration half = Duration::from_seconds(0.5 * scene_.config.camera.exposure_s);
  draw_snow(scene_.config.water.snow, view.light.state.silt.time_s, color, scene_.camera,
            request.T_world_camera(request.stamp - half),
            request.T_world_camera(request.stamp + half), scene_.seed, layers.nearest,
            layers.observed);
}

// From a few thousand pixels, and the backscatter of daylight along nine rays.
Medium SpectralRenderer::fit_medium(const View& view, const Layers& layers,
                                    const Eigen::Matrix3d& colors) const {
  constexpr int kEvery = 8;
  std::vector<SeenSurface> surfaces;
  for (int y = kEvery / 2; y < layers.range.rows; y += kEvery) {
    for (int x = kEvery / 2; x < layers.range.cols; x += kEvery) {
      const double range = layers.range.at<float>(y, x);
      if (range <= 0.0) continue;
      surfaces.push_back({.range = range,
                          .clear = colors * to_rgb(layers.clear.at<cv::Vec3f>(y, x)),
                          .direct = colors * to_rgb(layers.direct.at<cv::Vec3f>(y, x))});
    }
  }
  const BackscatterGrid daylight(thinned(scene_.lens, 4, 4), 1, view.T_world_camera, sea_,
                                 view.light.state, {}, scene_.world);
  const double reach =
      std::min(20.0, 4.0 / static_cast<double>(view.light.state.smooth[kGreenBand]));
  std::vector<SeenBackscatter> scattered_all;
  for (int i = 1; i <= 32; ++i) {
    const double range = reach * i / 32.0;
    Vector3f mean = Vector3f::Zero();
    for (int ray = 0; ray < 16; ++ray)
      mean += daylight.at(ray % 4, ray / 4, static_cast<float>(range)) / 16.0F;
    scattered_all.push_back({.range = range, .scattered = colors * mean.cast<double>()});
  }
  return effective_medium(surfaces, scattered_all);
}

RenderedFrame SpectralRenderer::render(const ImageRequest& request, int threads) const {
  const View view = view_of(request);
  const BackscatterGrid scattered = backscatter_of(view, scene_.lens, kTile);
  Layers layers = render_layers(view, scene_.lens, scattered, threads);
  const double bent = small_angle_fraction() - sharp_fraction();
  add_forward_blur({.focal_px = scene_.camera.parameters().fx,
                    .scattering = bent * static_cast<double>(view.light.state.scatter[kGreenBand])},
                   layers.blurred, layers.nearest, layers.observed);
  add_particles(request, view, scattered, layers);
  RenderedFrame frame;
  frame.development = request.development.value_or(choose(layers.observed));
  frame.development.gain *= request.disturbance.exposure;
  frame.gain = frame.development.gain;
  if (request.truth) frame.medium = fit_medium(view, layers, pipeline_.linear(frame.development));
  frame.image = pipeline_.image(layers.observed, frame.development, scene_.seed, request.frame);
  frame.clear =
      pipeline_.clear_image(layers.clear, request.clear_development.value_or(frame.development));
  frame.range = layers.range;
  frame.depth = layers.depth;
  if (view.moving != nullptr) frame.moving = layers.moving;
  return frame;
}

Development SpectralRenderer::choose(const cv::Mat& observed) const {
  return aim(to_rgb(pipeline_.mean_behind_lens(observed)), scene_.config.camera,
             scene_.config.spectral.white_balance, fixed_white_balance());
}

MeanLight SpectralRenderer::meter(const ImageRequest& request) const {
  View view = view_of(request);
  view.poses = {.samples = 1, .poses = {view.T_world_camera}, .rows = 1};
  const BackscatterGrid scattered = backscatter_of(view, meter_lens_, 4);
  const Layers layers = render_layers(view, meter_lens_, scattered, 1);
  return {.behind_lens = to_rgb(pipeline_.mean_behind_lens(layers.observed + layers.blurred)),
          .clear = to_rgb(cv::mean(layers.clear, layers.range > 0.0))};
}

}  // namespace apvi::sim
