// SPDX-License-Identifier: BSD-3-Clause
#include "sim/renderer.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "sim/shading.hpp"
#include "sim/snow.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr int kTile = 16;  // pixels per side; a tile has kBatch pixels
static_assert(kTile * kTile == kBatch);
constexpr float kMaxRange = 200.0F;  // [m]; beyond the visibility of any water

/// Rays of all pixels: unit vectors in the camera frame, zero where the distortion cannot be
/// inverted, and where they start in the camera frame [m] (empty: at the camera center).
struct Lens {
  int width = 0;
  int height = 0;
  std::vector<Vector3f> rays;
  std::vector<Vector3f> origins;
  std::vector<float> angle;  ///< between a pixel and its neighbor [rad]

  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(x);
  }
};

// A pixel without a ray gets a direction of zero.
WaterRay ray_of(const CameraModel& camera, const std::optional<PortCalibration>& port,
                const Vector2d& pixel) {
  WaterRay ray{Vector3d::Zero(), Vector3d::Zero()};
  if (!port) {
    ray.direction = camera.unproject(pixel).value_or(Vector3d::Zero());
  } else if (const auto bent = port->camera.ray(pixel)) {
    ray = {bent->origin + port->p_camera_lens, bent->direction};
  }
  return ray;
}

Lens make_lens(const CameraModel& camera, const std::optional<PortCalibration>& port) {
  const auto& p = camera.parameters();
  if (p.width < 2 || p.height < 2)
    fail_input("camera: an image of {} x {} px cannot be rendered", p.width, p.height);
  Lens lens{.width = p.width, .height = p.height, .rays = {}, .origins = {}, .angle = {}};
  const auto count = static_cast<std::size_t>(p.width) * static_cast<std::size_t>(p.height);
  lens.rays.reserve(count);
  for (int y = 0; y < p.height; ++y) {
    for (int x = 0; x < p.width; ++x) {
      const WaterRay ray = ray_of(camera, port, {x, y});
      lens.rays.emplace_back(ray.direction.cast<float>());
      if (port) lens.origins.emplace_back(ray.origin.cast<float>());
    }
  }
  lens.angle.reserve(count);
  for (int y = 0; y < p.height; ++y) {
    for (int x = 0; x < p.width; ++x) {
      const int neighbor = x + 1 < p.width ? x + 1 : x - 1;
      lens.angle.push_back(
          (lens.rays[lens.index(neighbor, y)] - lens.rays[lens.index(x, y)]).norm());
    }
  }
  return lens;
}

/// Offset of the k-th exposure sample from the pixel center, in pixels: zero for the middle sample,
/// spread for the others, so that motion blur also antialiases edges.
Vector2d pixel_offset(int k, int count) {
  if (2 * k + 1 == count) return Vector2d::Zero();
  const double angle = 2.399963 * k;
  return 0.35 * Vector2d(std::cos(angle), std::sin(angle));
}

/// Linear images before gain, shared by the rendering passes.
struct Canvas {
  cv::Mat observed, clear;  ///< CV_32FC3 BGR
  cv::Mat range, depth;
};

Canvas make_canvas(const Lens& lens) {
  const cv::Size size(lens.width, lens.height);
  return {.observed = cv::Mat::zeros(size, CV_32FC3),
          .clear = cv::Mat::zeros(size, CV_32FC3),
          .range = cv::Mat::zeros(size, CV_32F),
          .depth = cv::Mat::zeros(size, CV_32F)};
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

  /// Poses of one frame: one per exposure sample, or one per sample and row (rolling shutter).
  struct Poses {
    int samples = 1;
    std::vector<SE3> poses;
    std::size_t rows = 1;
    const SE3& at(int sample, int row) const {
      return poses[static_cast<std::size_t>(sample) * rows +
                   (rows > 1 ? static_cast<std::size_t>(row) : 0)];
    }
  };

  Vector3d white_balance;  ///< red, green, blue

  LightState light_state(const ImageRequest& request) const;
  int count_samples(const ImageRequest& request) const;
  Poses exposure_poses(const ImageRequest& request) const;
  void fill_rays(const Poses& poses, int sample, const cv::Rect& tile, TileRays& out) const;
  void render_tile(const LightState& light, const Poses& poses, const cv::Rect& tile,
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
  light.time_s = std::fmod(request.stamp.seconds(), 36000.0);
  const Vector3d around = daylight_at(light.config, light.medium, config.water.reference_depth_m);
  const double lamp = light.config.lamp ? 0.1 * light.config.lamp->intensity : 0.0;
  light.silt_color =
      (Vector3d(0.38, 0.36, 0.29).cwiseProduct(around + lamp * Vector3d::Ones())).cast<float>();
  return light;
}

// About one sample per pixel of image motion during the exposure; an odd number, so that one of
// them is at mid-exposure.
int Renderer::Impl::count_samples(const ImageRequest& request) const {
  const auto& p = camera.parameters();
  const Duration half = Duration::from_seconds(0.5 * config.camera.exposure_s);
  const SE3 T_start = request.T_world_camera(request.stamp - half);
  const SE3 T_end_inverse = request.T_world_camera(request.stamp + half).inverse();
  double motion = 0.0;
  for (const double fy : {0.1, 0.5, 0.9}) {
    for (const double fx : {0.1, 0.5, 0.9}) {
      const Vector2d pixel(fx * p.width, fy * p.height);
      const auto ray = camera.unproject(pixel);
      if (!ray) continue;
      const auto hit = caster->cast(T_start.translation, T_start.rotation * *ray, 20.0);
      const Vector3d point = T_start * Vector3d((hit ? hit->range : 20.0) * *ray);
      const auto later = camera.project(T_end_inverse * point);
      if (later) motion = std::max(motion, (*later - pixel).norm());
    }
  }
  const int wanted = 1 + 2 * static_cast<int>(std::ceil(0.5 * (std::min(motion, 100.0) - 0.75)));
  return std::clamp(wanted, 1, (config.camera.blur_samples - 1) / 2 * 2 + 1);
}

Renderer::Impl::Poses Renderer::Impl::exposure_poses(const ImageRequest& request) const {
  Poses result;
  result.samples = count_samples(request);
  const bool rolling = config.camera.shutter == Shutter::rolling;
  result.rows = rolling ? static_cast<std::size_t>(lens.height) : 1;
  for (int k = 0; k < result.samples; ++k) {
    const double phase = (k + 0.5) / result.samples - 0.5;
    for (std::size_t row = 0; row < result.rows; ++row) {
      const double place = rolling ? (static_cast<double>(row) + 0.5) / lens.height - 0.5 : 0.0;
      const double offset = phase * config.camera.exposure_s + place * config.camera.readout_s;
      result.poses.push_back(
          request.T_world_camera(request.stamp + Duration::from_seconds(offset)));
    }
  }
  return result;
}

void Renderer::Impl::fill_rays(const Poses& poses, int sample, const cv::Rect& tile,
                               TileRays& out) const {
  const Vector2d shift = pixel_offset(sample, poses.samples);
  out.rays.resize(static_cast<std::size_t>(tile.area()));
  std::size_t i = 0;
  for (int y = tile.y; y < tile.y + tile.height; ++y) {
    const SE3& T_world_camera = poses.at(sample, y);
    const Eigen::Matrix3f R = T_world_camera.rotation.toRotationMatrix().cast<float>();
    const Vector3f center = T_world_camera.translation.cast<float>();
    const int y2 = y + 1 < lens.height ? y + 1 : y - 1;
    for (int x = tile.x; x < tile.x + tile.width; ++x, ++i) {
      const Vector3f& ray = lens.rays[lens.index(x, y)];
      Vector3f d = ray;
      if (sample * 2 + 1 != poses.samples) {
        const int x2 = x + 1 < lens.width ? x + 1 : x - 1;
        const auto sx = static_cast<float>(shift.x());
        const auto sy = static_cast<float>(shift.y());
        d += sx * (lens.rays[lens.index(x2, y)] - ray) + sy * (lens.rays[lens.index(x, y2)] - ray);
        d.normalize();
      }
      const Vector3f world = R * d;
      const Vector3f origin =
          lens.origins.empty() ? center : Vector3f(center + R * lens.origins[lens.index(x, y)]);
      out.rays.ox[i] = origin.x();
      out.rays.oy[i] = origin.y();
      out.rays.oz[i] = origin.z();
      out.rays.dx[i] = world.x();
      out.rays.dy[i] = world.y();
      out.rays.dz[i] = world.z();
      // Pixels without a ray get a tiny range and hit nothing.
      out.rays.range[i] = ray.isZero() ? 1e-3F : kMaxRange;
      out.pixel_angle[static_cast<int>(i)] = lens.angle[lens.index(x, y)];
    }
  }
}

void Renderer::Impl::render_tile(const LightState& light, const Poses& poses, const cv::Rect& tile,
                                 Canvas& canvas) const {
  TileRays rays;
  const float weight = 1.0F / static_cast<float>(poses.samples);
  for (int k = 0; k < poses.samples; ++k) {
    fill_rays(poses, k, tile, rays);
    const SE3& T_world_camera = poses.at(k, tile.y + tile.height / 2);
    if (light.config.lamp) {
      const auto& at = light.config.lamp->position_m;
      rays.lamp_position = (T_world_camera * Vector3d(at[0], at[1], at[2])).cast<float>();
      rays.lamp_axis = (T_world_camera.rotation * Vector3d::UnitZ()).cast<float>();
    }
    caster->cast(rays.rays);
    shade(*mesh, baked, light, rays);
    const bool middle = 2 * k + 1 == poses.samples;
    for (int i = 0; i < tile.area(); ++i) {
      const int x = tile.x + i % tile.width;
      const int y = tile.y + i / tile.width;
      auto& observed = canvas.observed.at<cv::Vec3f>(y, x);
      for (int c = 0; c < 3; ++c) observed[c] += weight * rays.observed[2 - c][i];
      if (!middle) continue;
      auto& clear = canvas.clear.at<cv::Vec3f>(y, x);
      for (int c = 0; c < 3; ++c) clear[c] = rays.clear[2 - c][i];
      const float range = rays.rays.range[static_cast<std::size_t>(i)];
      if (range < 0.0F) continue;
      canvas.range.at<float>(y, x) = range;
      const float start = lens.origins.empty() ? 0.0F : lens.origins[lens.index(x, y)].z();
      canvas.depth.at<float>(y, x) = start + range * lens.rays[lens.index(x, y)].z();
    }
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
  frame.gain = camera_gain(canvas, request.disturbance.exposure);
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
}

Renderer::~Renderer() = default;
Renderer::Renderer(Renderer&&) noexcept = default;
Renderer& Renderer::operator=(Renderer&&) noexcept = default;

RenderedFrame Renderer::render(const ImageRequest& request, int threads) const {
  const LightState light = impl_->light_state(request);
  const Impl::Poses poses = impl_->exposure_poses(request);
  Canvas canvas = make_canvas(impl_->lens);
  const int columns = (impl_->lens.width + kTile - 1) / kTile;
  const int rows = (impl_->lens.height + kTile - 1) / kTile;
  parallel_for(columns * rows, threads, [&](int i) {
    const cv::Rect tile(i % columns * kTile, i / columns * kTile, kTile, kTile);
    const cv::Rect all(0, 0, impl_->lens.width, impl_->lens.height);
    impl_->render_tile(light, poses, tile & all, canvas);
  });
  const Duration half = Duration::from_seconds(0.5 * impl_->config.camera.exposure_s);
  draw_snow(
      impl_->config.water.snow, light, impl_->camera, request.T_world_camera(request.stamp - half),
      request.T_world_camera(request.stamp + half), impl_->seed, canvas.range, canvas.observed);
  return impl_->make_frame(request, light, canvas);
}

}  // namespace apvi::sim
