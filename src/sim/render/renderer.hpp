// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "apvi/core/stamp.hpp"
#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "apvi/sensors/rig.hpp"
#include "sim/motion/disturbance.hpp"
#include "sim/render/camera_effects.hpp"
#include "sim/render/light.hpp"
#include "sim/render/ray_caster.hpp"
#include "sim/render/water.hpp"
#include "sim/spectral/development.hpp"
#include "sim/spectral/spectral_config.hpp"
#include "sim/world/mesh.hpp"

namespace apvi::sim {

struct MovingScene;

struct ImageRequest {
  Stamp stamp;              ///< mid-exposure; of the middle row with a rolling shutter
  std::uint64_t frame = 0;  ///< seeds the noise; frames may be rendered in any order
  std::function<SE3(Stamp)> T_world_camera;  ///< camera: x right, y down, z forward
  Disturbance disturbance;
  /// Of the camera; null: as this frame asks for. Paper's physics only.
  std::optional<double> gain{};
  /// Exposure and white balance that the camera chose; null: as this frame asks for. Spectral only.
  std::optional<Development> development{};
  std::optional<Development> clear_development{};  ///< of `clear`; null: as of the image
  std::shared_ptr<const MovingScene> moving{};     ///< at mid-exposure; null: nothing moves
  bool truth = true;  ///< spectral: whether to fit the effective medium
};

struct RenderedFrame {
  cv::Mat image;  ///< CV_8UC3 BGR, the camera image
  cv::Mat depth;  ///< CV_32F, meters along the optical axis at mid-exposure, 0 for no surface
  cv::Mat range;  ///< CV_32F, meters along the ray in the water, 0 for no surface
  cv::Mat clear;  ///< CV_8UC3 BGR: the water-free scene J
  /// CV_8U: kMovingBody where something that moves is seen during any part of the exposure,
  /// kMovingShadow for its shadow, else 0. Depth, range and clear are without it, but with its
  /// shadow. Empty if nothing moves.
  cv::Mat moving;
  /// Of this frame; b_inf in image units (includes gain and white balance). Spectral: effective.
  Medium medium;
  double gain = 1.0;
  Development development;  ///< spectral only
};

struct RendererConfig {
  WaterConfig water;
  LightConfig light;
  CameraEffectsConfig camera;
  Physics physics = Physics::paper;
  SpectralConfig spectral{};
};

/// Renders camera images. `render` is thread-safe; the result depends only on the seed and the
/// request, bit by bit.
class Renderer {
 public:
  /// `mesh` and `caster` must outlive the renderer. Bakes ambient occlusion with `threads` threads.
  /// With a port, every pixel has the ray that the port bends; `camera` is then the central model,
  /// whose frame requests and depth images refer to.
  Renderer(const TriangleMesh& mesh, const RayCaster& caster, const CameraModel& camera,
           const RendererConfig& config, std::uint64_t seed, int threads = 1,
           const std::optional<PortCalibration>& port = std::nullopt);
  ~Renderer();
  Renderer(Renderer&&) noexcept;
  Renderer& operator=(Renderer&&) noexcept;

  /// Renders one frame, with its tiles distributed over `threads` threads.
  RenderedFrame render(const ImageRequest& request, int threads = 1) const;
  /// Spectral physics: mean light of the image (see SpectralRenderer).
  MeanLight meter(const ImageRequest& request) const;
  /// Spectral physics: white balance of the modes other than automatic.
  Eigen::Vector3d fixed_white_balance() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace apvi::sim
