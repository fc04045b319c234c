// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <string_view>
#include <vector>

#include "apvi/splat/gaussians.hpp"
#include "apvi/splat/view.hpp"

namespace apvi::splat {

/// What the rasterizer takes, checked already: tensors on one device, of one floating type (CUDA:
/// float32), contiguous, without autograd.
struct RasterInput {
  Gaussians gaussians;
  torch::Tensor light = {};      ///< [N,3], by which colours are multiplied; undefined: one
  torch::Tensor background;      ///< [3]
  torch::Tensor T_camera_world;  ///< [4,4] float64 on the CPU
  Intrinsics intrinsics;
  int sh_degree = 0;  ///< to be used, not more than the map has
  double near_m = 0.0;
  double low_pass_px2 = 0.0;
  bool antialiased = false;
  /// Nothing but the images is wanted: no statistics of the Gaussians, nothing to walk back with.
  /// The images have the same bits either way.
  bool images_only = false;
};

/// What the forward pass leaves for the backward pass, in a form that only its backend knows. Freed
/// with the last copy; nothing else keeps the pass alive.
using RasterState = std::vector<torch::Tensor>;

struct RasterOutput {
  torch::Tensor color;       ///< [H,W,3]
  torch::Tensor depth;       ///< [H,W] expected depth [m], 0 where alpha is 0
  torch::Tensor alpha;       ///< [H,W]
  torch::Tensor visible;     ///< [N] bool; this and the next three undefined with `images_only`
  torch::Tensor radii_px;    ///< [N]
  torch::Tensor max_weight;  ///< [N]
  RasterState state;
};

/// Derivatives of a loss by the images of a `RasterOutput`.
struct RasterOutputGradient {
  torch::Tensor color;  ///< [H,W,3]
  torch::Tensor depth;  ///< [H,W]; undefined: zero
  torch::Tensor alpha;  ///< [H,W]; undefined: zero
};

struct RasterInputGradient {
  Gaussians gaussians;  ///< undefined when `rows` is what was asked for
  GaussianRows rows;
  torch::Tensor background;  ///< [3]
  torch::Tensor pose;        ///< [6] float64, by a left perturbation: translation, rotation
  torch::Tensor mean2d;      ///< [N] norm of the derivative by the centre, in half image sizes
};

/// The seam between CPU and CUDA: both take and return the same tensors. Nothing here is recorded
/// by autograd; the one function that is lies above (src/splat/render.cpp). Both draw the same
/// splats in the same order, see splat_math.hpp.
class RasterBackend {
 public:
  RasterBackend() = default;
  RasterBackend(const RasterBackend&) = delete;
  RasterBackend& operator=(const RasterBackend&) = delete;
  virtual ~RasterBackend() = default;

  virtual std::string_view name() const = 0;
  virtual RasterOutput forward(const RasterInput& input) const = 0;
  /// Whether it can give the derivatives by the Gaussians as rows.
  virtual bool has_rows() const { return false; }
  /// `output` as `forward` gave it for this very input, without `images_only`. `as_rows` only where
  /// `has_rows`.
  virtual RasterInputGradient backward(const RasterInput& input, const RasterOutput& output,
                                       const RasterOutputGradient& grad, bool as_rows) const = 0;
};

/// cpu_fallback/raster.cpp; float32 and float64, the same bits with any number of threads. One for
/// every instruction set that this processor has and the float path can use; the fastest first.
const std::vector<const RasterBackend*>& cpu_raster_backends();

/// kernels/cuda_raster.cpp, in builds with APVI_BACKEND=cuda; float32.
const RasterBackend& cuda_raster_backend();

/// The backend for tensors on `device`. Throws c10::Error for one this build has no backend for.
const RasterBackend& raster_backend(const torch::Device& device);

}  // namespace apvi::splat
