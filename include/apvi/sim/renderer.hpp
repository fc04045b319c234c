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
#include "apvi/sim/camera_effects.hpp"
#include "apvi/sim/light.hpp"
#include "apvi/sim/mesh.hpp"
#include "apvi/sim/ray_caster.hpp"
#include "apvi/sim/water.hpp"

namespace apvi::sim {

/// What goes wrong at one instant; the defaults are a good day.
struct Disturbance {
  std::optional<double> attenuation_length_m{};  ///< visibility, instead of the water's own [m]
  double darkness =
      0.0;            ///< 1: no light at all (blackout); scales daylight, lamp and veil by 1 - x
  double silt = 0.0;  ///< density of a cloud of stirred-up silt, 1: hides nearly everything
  double exposure = 1.0;  ///< factor on the gain after metering; 4 burns the picture out
};

struct ImageRequest {
  Stamp stamp;              ///< mid-exposure; of the middle row with a rolling shutter
  std::uint64_t frame = 0;  ///< keys the noise; frames may be rendered in any order
  std::function<SE3(Stamp)> T_world_camera;  ///< camera: x right, y down, z forward
  Disturbance disturbance;
};

struct RenderedFrame {
  cv::Mat image;  ///< CV_8UC3 BGR, as the camera gives it
  cv::Mat depth;  ///< CV_32F, metres along the optical axis at mid-exposure, 0 where nothing is
  cv::Mat range;  ///< CV_32F, metres along the ray, 0 where nothing is
  cv::Mat clear;  ///< CV_8UC3 BGR: the scene J without water, gain and response of this frame
  Medium medium;  ///< that was in force; b_inf in units of this image (gain and white balance in)
  double gain = 1.0;
};

struct RendererConfig {
  WaterConfig water;
  LightConfig light;
  CameraEffectsConfig camera;
};

/// Draws what a camera sees. Rendering does not change the object: call it from any number of
/// threads; the bytes depend on the seed and the request alone.
class Renderer {
 public:
  /// `mesh` and `caster` must outlive the renderer. Bakes ambient occlusion with `threads` threads.
  Renderer(const TriangleMesh& mesh, const RayCaster& caster, const CameraModel& camera,
           const RendererConfig& config, std::uint64_t seed, int threads = 1);
  ~Renderer();
  Renderer(Renderer&&) noexcept;
  Renderer& operator=(Renderer&&) noexcept;

  /// Renders one frame, its tiles spread over `threads` threads.
  RenderedFrame render(const ImageRequest& request, int threads = 1) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace apvi::sim
