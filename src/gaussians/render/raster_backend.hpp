// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <string_view>
#include <vector>

#include "gaussians/model/gaussians.hpp"
#include "gaussians/render/view.hpp"

namespace apvi::gaussians {

/// Rasterizer input, already validated: tensors on one device, of one floating type (CUDA:
/// float32), contiguous, detached from autograd.
struct RasterInput {
  Gaussians gaussians;
  torch::Tensor light = {};      ///< [N,3] per-Gaussian color factor; undefined: one
  torch::Tensor background;      ///< [3]
  torch::Tensor T_camera_world;  ///< [4,4] float64 on the CPU
  Intrinsics intrinsics;
  int sh_degree = 0;  ///< degree to evaluate, at most that of the map
  double near_m = 0.0;
  double low_pass_px2 = 0.0;
  bool antialiased = false;
  /// Only the images are needed: no per-Gaussian statistics and no state for the backward pass. The
  /// images are bitwise identical either way.
  bool images_only = false;
};

/// State saved for the backward pass, in a backend-specific form. Freed with the last copy.
using RasterState = std::vector<torch::Tensor>;

struct RasterOutput {
  torch::Tensor color;       ///< [H,W,3]
  torch::Tensor depth;       ///< [H,W] expected depth [m], 0 where alpha is 0
  torch::Tensor alpha;       ///< [H,W]
  torch::Tensor visible;     ///< [N] bool; this and the next two are undefined with `images_only`
  torch::Tensor radii_px;    ///< [N]
  torch::Tensor max_weight;  ///< [N]
  RasterState state;
};

/// Derivatives of a loss with respect to the images of a `RasterOutput`.
struct RasterOutputGradient {
  torch::Tensor color;  ///< [H,W,3]
  torch::Tensor depth;  ///< [H,W]; undefined: zero
  torch::Tensor alpha;  ///< [H,W]; undefined: zero
};

struct RasterInputGradient {
  Gaussians gaussians;  ///< undefined when `sparse` was requested
  SparseGradient sparse;
  torch::Tensor background;  ///< [3]
  torch::Tensor pose;        ///< [6] float64, left perturbation: translation, rotation
  torch::Tensor
      mean2d;  ///< [N] norm of the derivative by the projected center, in half image sizes
};

/// Interface of the CPU and CUDA rasterizers: both take and return the same tensors. Not recorded
/// by autograd; src/gaussians/render/render.cpp wraps it in an autograd function. Both blend the
/// same splats in the same order, see splat_math.hpp.
class RasterBackend {
 public:
  RasterBackend() = default;
  RasterBackend(const RasterBackend&) = delete;
  RasterBackend& operator=(const RasterBackend&) = delete;
  virtual ~RasterBackend() = default;

  virtual std::string_view name() const = 0;
  virtual RasterOutput forward(const RasterInput& input) const = 0;
  /// Whether it can return the derivatives with respect to the Gaussians in sparse form.
  virtual bool has_sparse_gradient() const { return false; }
  /// `output`: result of `forward` for the same input, without `images_only`. `as_sparse` only
  /// where `has_sparse_gradient`.
  virtual RasterInputGradient backward(const RasterInput& input, const RasterOutput& output,
                                       const RasterOutputGradient& grad, bool as_sparse) const = 0;
};

/// cpu_fallback/raster/raster.cpp; float32 and float64, bitwise identical for any number of
/// threads. One backend for every instruction set that this processor supports, the fastest first.
const std::vector<const RasterBackend*>& cpu_raster_backends();

/// kernels/raster/cuda_raster.cpp, in builds with APVI_BACKEND=cuda; float32.
const RasterBackend& cuda_raster_backend();

/// The backend for tensors on `device`. Throws c10::Error if this build has none.
const RasterBackend& raster_backend(const torch::Device& device);

}  // namespace apvi::gaussians
