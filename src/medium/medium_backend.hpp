// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <string_view>
#include <vector>

#include "gaussians/render/splat_math.hpp"
#include "medium/lamp.hpp"

namespace apvi::medium {

/// Inputs of the medium model. All tensors on one device, of one floating-point type (CUDA:
/// float32), contiguous.
struct MediumInput {
  torch::Tensor color;        ///< [H,W,3] without medium, alpha-weighted, linear
  torch::Tensor depth;        ///< [H,W] of the surface [m], finite; times `ray_lengths`: range
  torch::Tensor alpha;        ///< [H,W] opacity
  torch::Tensor beta_d;       ///< [3] attenuation coefficient, RGB [1/m]
  torch::Tensor beta_b;       ///< [3] backscatter coefficient, RGB [1/m]
  torch::Tensor b_inf;        ///< [3] veiling light, RGB
  torch::Tensor ray_lengths;  ///< [H,W] ray length at unit depth; undefined: one
  torch::Tensor
      lamp_backscatter;  ///< [1,3,steps,nodes,nodes] lamp_backscatter_table; undefined: no lamp
};

/// View of `MediumInput::lamp_backscatter` for interpolation in the backends.
template <typename T>
gaussians::BackscatterTable<T> backscatter_table(const MediumInput& input) {
  if (!input.lamp_backscatter.defined()) return {};
  return {input.lamp_backscatter.data_ptr<T>(), static_cast<int>(input.lamp_backscatter.size(2)),
          static_cast<int>(input.lamp_backscatter.size(3)), static_cast<T>(kLampMaxRange_m)};
}

/// Inputs of the lamp illumination. Tensors as above.
struct LampInput {
  torch::Tensor means;           ///< [N,3] in the world [m]
  torch::Tensor T_camera_world;  ///< [4,4] float64 on the CPU
  std::vector<Lamp> lamps;
  double unit_range_m = 1.0;
  torch::Tensor beta_d;    ///< [3]
  torch::Tensor daylight;  ///< [3]
};

/// Interface of the CPU and CUDA implementations, which take and return the same tensors. Not
/// recorded by autograd; the differentiable function is `apply_medium`.
class MediumBackend {
 public:
  MediumBackend() = default;
  MediumBackend(const MediumBackend&) = delete;
  MediumBackend& operator=(const MediumBackend&) = delete;
  virtual ~MediumBackend() = default;

  virtual std::string_view name() const = 0;
  /// The image with the medium applied [H,W,3].
  virtual torch::Tensor forward(const MediumInput& input) const = 0;
  /// Gradients of a loss with respect to color, depth, alpha and, if `with_medium_gradients`,
  /// beta_d, beta_b and b_inf, from its gradient with respect to the image [H,W,3]. The lamp
  /// backscatter gets none.
  virtual MediumInput backward(const MediumInput& input, const torch::Tensor& grad_image,
                               bool with_medium_gradients) const = 0;
  /// Illumination [N,3] of points, see LampLight; the default uses LibTorch operators.
  virtual torch::Tensor lamp_light(const LampInput& input) const;
};

/// cpu_fallback/medium/medium.cpp; float32 and float64, bit-identical for any number of threads.
const MediumBackend& cpu_medium_backend();
/// kernels/medium/cuda_medium.cpp, in builds with APVI_BACKEND=cuda.
const MediumBackend& cuda_medium_backend();

/// The backend for tensors on `device`. Throws c10::Error if this build has none for it.
const MediumBackend& medium_backend(const torch::Device& device);

}  // namespace apvi::medium
