// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "sim/render/lens_rays.hpp"
#include "sim/render/renderer.hpp"
#include "sim/spectral/backscatter_grid.hpp"
#include "sim/spectral/camera_pipeline.hpp"
#include "sim/spectral/spectral_shading.hpp"

namespace apvi::sim {

/// What a frame is rendered from; all of it outlives the renderer.
struct RenderScene {
  const TriangleMesh& mesh;
  const RayCaster& world;
  const BakedLight& baked;
  const CameraModel& camera;
  const Lens& lens;
  const RendererConfig& config;
  std::uint64_t seed;
};

/// Renders frames by spectral physics; thread-safe, and deterministic.
class SpectralRenderer {
 public:
  explicit SpectralRenderer(const RenderScene& scene);

  RenderedFrame render(const ImageRequest& request, int threads) const;
  /// Mean light of the image, from a small and sharp rendering of it.
  MeanLight meter(const ImageRequest& request) const;
  /// White balance of the modes other than automatic.
  Eigen::Vector3d fixed_white_balance() const;

 private:
  struct Layers;
  struct View;

  static void add_moving_shadows(const View& view, TileSurface& surface, TileRays& rays);
  static void draw_moving(const View& view, TileRays& rays, Lanes (&soft)[3]);
  View view_of(const ImageRequest& request) const;
  BackscatterGrid backscatter_of(const View& view, const Lens& lens, int step) const;
  void render_tile(const View& view, const Lens& lens, const BackscatterGrid& scattered, int sample,
                   const cv::Rect& tile, Layers& layers) const;
  Layers render_layers(const View& view, const Lens& lens, const BackscatterGrid& scattered,
                       int threads) const;
  void add_particles(const ImageRequest& request, const View& view,
                     const BackscatterGrid& scattered, Layers& layers) const;
  Development choose(const cv::Mat& observed) const;
  Medium fit_medium(const View& view, const Layers& layers, const Eigen::Matrix3d& colors) const;

  RenderScene scene_;
  Sea sea_;
  CameraPipeline pipeline_;
  Lens meter_lens_;
};

}  // namespace apvi::sim
