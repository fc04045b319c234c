// SPDX-License-Identifier: BSD-3-Clause
#include "sim/render/renderer.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "sim/render/frame_poses.hpp"
#include "sim/render/lens_rays.hpp"
#include "sim/render/shading.hpp"
#include "sim/render/snow.hpp"
#include "sim/spectral/spectral_renderer.hpp"
#include "sim/world/moving_scene.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr int kTile = 16;  // pixels per side; a tile has kBatch pixels
static_assert(kTile * kTile == kBatch);

/// Linear images before gain, shared by the rendering passes.
struct Canvas {
  cv::Mat observed, clear;  ///< CV_32FC3 BGR
  cv::Mat range, depth;
  cv::Mat nearest;  ///< like `range`, to what moves where that is nearer
  cv::Mat moving;   ///< CV_8U, see RenderedFrame

  void store_middle(const Lens& lens, const cv::Rect& tile, const TileRays& rays);
  void add_exposed(float weight, bool middle, const cv::Rect& tile, const TileRays& rays);
};

Canvas make_canvas(const Lens& lens) {
  const cv::Size size(lens.width, lens.height);
  return {.observed = cv::Mat::zeros(size, CV_32FC3),
          .clear = cv::Mat::zeros(size, CV_32FC3),
          .range = cv::Mat::zeros(size, CV_32F),
          .depth = cv::Mat::zeros(size, CV_32F),
          .nearest = cv::Mat::zeros(size, CV_32F),
          .moving = cv::Mat::zeros(size, CV_8U)};
}

// What is seen without what moves.
void Canvas::store_middle(const Lens& lens, const cv::Rect& tile, const TileRays& rays) {
  for (int i = 0; i < tile.area(); ++i) {
    const int x = tile.x + i % tile.width;
    const int y = tile.y + i / tile.width;
    for (int c = 0; c < 3; ++c) clear.at<cv::Vec3f>(y, x)[c] = rays.clear[2 - c][i];
    const float along = rays.rays.range[static_cast<std::size_t>(i)];
    if (along < 0.0F) continue;
    range.at<float>(y, x) = along;
    const float start = lens.origins.empty() ? 0.0F : lens.origins[lens.index(x, y)].z();
    depth.at<float>(y, x) = start + along * lens.rays[lens.index(x, y)].z();
  }
}

void Canvas::add_exposed(float weight, bool middle, const cv::Rect& tile, const TileRays& rays) {
  for (int i = 0; i < tile.area(); ++i) {
    const auto lane = static_cast<std::size_t>(i);
    const cv::Point at(tile.x + i % tile.width, tile.y + i / tile.width);
    auto& pixel = observed.at<cv::Vec3f>(at);
    for (int c = 0; c < 3; ++c) pixel[c] += weight * rays.observed[2 - c][i];
    auto& mark = moving.at<std::uint8_t>(at);
    mark = std::max(mark, rays.moving[lane]);
    if (middle) nearest.at<float>(at) = std::max(0.0F, rays.rays.range[lane]);
  }
}

// Replaces what the rays see by what moves in front of it.
void draw_moving(const LightState& light, TileRays& rays) {
  TileRays front;
  if (!cast_in_front(*light.moving, rays, front)) return;
  shade(light.moving->mesh, light.moving->baked, light, front);
  for (std::size_t i = 0; i < front.rays.size(); ++i) {
    if (front.rays.range[i] < 0.0F) continue;
    const auto lane = static_cast<int>(i);
    for (std::size_t c = 0; c < 3; ++c) rays.observed[c][lane] = front.observed[c][lane];
    rays.rays.range[i] = front.rays.range[i];
    rays.moving[i] = kMovingBody;
  }
}

}  // namespace

struct Renderer::Impl {
  const TriangleMesh* mesh = nullptr;
  const RayCaster* caster = nullptr;
  CameraModel camera;
  RendererConfig config;
  std::uint64_t seed = 0;
  Lens lens;
  BakedLight baked;

  Vector3d white_balance;                        ///< red, green, blue
  std::unique_ptr<SpectralRenderer> spectral{};  ///< null: paper physics

  LightState light_state(const ImageRequest& request) const;
  void render_tile(const LightState& light, const FramePoses& poses, const cv::Rect& tile,
                   Canvas& canvas) const;
  double camera_gain(const Canvas& canvas, double exposure) const;
  RenderedFrame make_frame(const ImageRequest& request, const LightState& light,
                           const Canvas& canvas) const;
};

LightState Renderer::Impl::light_state(const ImageRequest& request) const {
  const Disturbance& d = request.disturbance;
  const double brightness = std::clamp(1.0 - d.darkness, 0.0, 1.0);
  LightState light{.config = config.light,
                   .medium = make_medium(config.water, d.attenuation_length_m)};
  light.config.daylight *= brightness;
  if (light.config.lamp) light.config.lamp->intensity *= brightness;
  light.medium.b_inf *= config.light.daylight * brightness;
  light.veiling_light_gradient = config.water.veiling_light_gradient;
  light.silt = d.silt;
  light.moving = request.moving.get();
  light.time_s = std::fmod(request.stamp.seconds(), 36000.0);
  const Vector3d around = daylight_at(light.config, light.medium, config.water.reference_depth_m);
  const double lamp = light.config.lamp ? 0.1 * light.config.lamp->intensity : 0.0;
  light.silt_color =
      (Vector3d(0.38, 0.36, 0.29).cwiseProduct(around + lamp * Vector3d::Ones())).cast<float>();
  return light;
}

void Renderer::Impl::render_tile(const LightState& light, const FramePoses& poses,
                                 const cv::Rect& tile, Canvas& canvas) const {
  TileRays rays;
  const float weight = 1.0F / static_cast<float>(poses.samples);
  for (int k = 0; k < poses.samples; ++k) {
    fill_rays(lens, poses, k, tile, rays);
    const SE3& T_world_camera = poses.at(k, tile.y + tile.height / 2);
    if (light.config.lamp) {
      const auto& at = light.config.lamp->position_m;
      rays.lamp_position = (T_world_camera * Vector3d(at[0], at[1], at[2])).cast<float>();
      rays.lamp_axis = (T_world_camera.rotation * Vector3d::UnitZ()).cast<float>();
    }
    caster->cast(rays.rays);
    shade(*mesh, baked, light, rays);
    const bool middle = 2 * k + 1 == poses.samples;
    if (middle) canvas.store_middle(lens, tile, rays);
    if (light.moving != nullptr) draw_moving(light, rays);
    canvas.add_exposed(weight, middle, tile, rays);
  }
}

// Gain that brings the mean of the image (Bayer weights) to the target, times `exposure`.
double Renderer::Impl::camera_gain(const Canvas& canvas, double exposure) const {
  const CameraEffectsConfig& camera_config = config.camera;
  if (!camera_config.auto_gain) return camera_config.gain * exposure;
  const cv::Scalar mean = cv::mean(canvas.observed);
  const double level = 0.25 * mean[0] * white_balance.z() + 0.5 * mean[1] * white_balance.y() +
                       0.25 * mean[2] * white_balance.x();
  return exposure *
         std::min(camera_config.max_gain, camera_config.target_mean / std::max(level, 1e-9));
}

RenderedFrame Renderer::Impl::make_frame(const ImageRequest& request, const LightState& light,
                                         const Canvas& canvas) const {
  RenderedFrame frame;
  frame.gain = request.gain ? *request.gain : camera_gain(canvas, request.disturbance.exposure);
  frame.medium = light.medium;
  Vector3f factor;
  for (int c = 0; c < 3; ++c) {
    frame.medium.b_inf[c] *= frame.gain * white_balance[c];
    factor[c] = static_cast<float>(frame.gain * white_balance[c]);
  }
  cv::Mat exposed(canvas.observed.size(), CV_32FC3);
  cv::Mat clear(canvas.observed.size(), CV_32FC3);
  const float radius2 =
      0.25F * static_cast<float>(lens.width * lens.width + lens.height * lens.height);
  for (int y = 0; y < lens.height; ++y) {
    for (int x = 0; x < lens.width; ++x) {
      const float dx = static_cast<float>(x) - 0.5F * static_cast<float>(lens.width);
      const float dy = static_cast<float>(y) - 0.5F * static_cast<float>(lens.height);
      const float corner = (dx * dx + dy * dy) / radius2;
      const float lens_loss = 1.0F - static_cast<float>(config.camera.vignetting) * corner;
      const auto& in = canvas.observed.at<cv::Vec3f>(y, x);
      const auto& clear_pixel = canvas.clear.at<cv::Vec3f>(y, x);
      for (int c = 0; c < 3; ++c) {
        exposed.at<cv::Vec3f>(y, x)[c] = in[c] * factor[2 - c] * lens_loss;
        clear.at<cv::Vec3f>(y, x)[c] = clear_pixel[c] * factor[2 - c];
      }
    }
  }
  if (config.camera.lens_blur_px > 0.0) {
    for (cv::Mat* layer : {&exposed, &clear}) {
      gaussian_blur(*layer, config.camera.lens_blur_px);
    }
  }
  frame.image = simulate_sensor(exposed, config.camera, frame.gain, seed, request.frame);
  frame.clear = simulate_noiseless_sensor(clear, config.camera);
  frame.range = canvas.range;
  frame.depth = canvas.depth;
  if (light.moving != nullptr) frame.moving = canvas.moving;
  return frame;
}

Renderer::Renderer(const TriangleMesh& mesh, const RayCaster& caster, const CameraModel& camera,
                   const RendererConfig& config, std::uint64_t seed, int threads,
                   const std::optional<PortCalibration>& port)
    : impl_(std::make_unique<Impl>()) {
  impl_->mesh = &mesh;
  impl_->caster = &caster;
  impl_->camera = camera;
  impl_->config = config;
  impl_->seed = seed;
  impl_->lens = make_lens(camera, port);
  impl_->white_balance =
      scene_white_balance(config.light, make_medium(config.water), config.water.reference_depth_m);
  if (const auto& given = config.camera.white_balance) {
    impl_->white_balance = Vector3d((*given)[0], (*given)[1], (*given)[2]);
  }
  impl_->baked = bake_light(mesh, caster, sun_direction(config.light).cast<float>(), threads);
  if (config.physics == Physics::paper) return;
  impl_->spectral = std::make_unique<SpectralRenderer>(
      RenderScene{mesh, caster, impl_->baked, impl_->camera, impl_->lens, impl_->config, seed});
}

Renderer::~Renderer() = default;
Renderer::Renderer(Renderer&&) noexcept = default;
Renderer& Renderer::operator=(Renderer&&) noexcept = default;

MeanLight Renderer::meter(const ImageRequest& request) const {
  return impl_->spectral->meter(request);
}

Vector3d Renderer::fixed_white_balance() const {
  return impl_->spectral->fixed_white_balance();
}

RenderedFrame Renderer::render(const ImageRequest& request, int threads) const {
  if (impl_->spectral) return impl_->spectral->render(request, threads);
  const LightState light = impl_->light_state(request);
  const FramePoses poses =
      frame_poses(request, {impl_->camera, impl_->config.camera, *impl_->caster});
  Canvas canvas = make_canvas(impl_->lens);
  const int columns = (impl_->lens.width + kTile - 1) / kTile;
  const int rows = (impl_->lens.height + kTile - 1) / kTile;
  parallel_for(columns * rows, threads, [&](int i) {
    const cv::Rect tile(i % columns * kTile, i / columns * kTile, kTile, kTile);
    const cv::Rect all(0, 0, impl_->lens.width, impl_->lens.height);
    impl_->render_tile(light, poses, tile & all, canvas);
  });
  const Duration half = Duration::from_seconds(0.5 * impl_->config.camera.exposure_s);
  draw_snow(impl_->config.water.snow, light.time_s, snow_color(light), impl_->camera,
            request.T_world_camera(request.stamp - half),
            request.T_world_camera(request.stamp + half), impl_->seed, canvas.nearest,
            canvas.observed);
  return impl_->make_frame(request, light, canvas);
}

}  // namespace apvi::sim
