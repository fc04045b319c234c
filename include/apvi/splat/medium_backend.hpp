// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <string_view>

#include "apvi/splat/lamp.hpp"
#include "apvi/splat/splat_math.hpp"

namespace apvi::splat {

/// What the water model takes. All tensors on one device, of one floating type (CUDA: float32),
/// contiguous.
struct MediumInput {
  torch::Tensor color;        ///< [H,W,3] without water, alpha-weighted, linear
  torch::Tensor depth;        ///< [H,W] of the surface [m], finite; times `ray_lengths` its range
  torch::Tensor alpha;        ///< [H,W] opacity
  torch::Tensor beta_d;       ///< [3] attenuation of the direct light, RGB [1/m]
  torch::Tensor beta_b;       ///< [3] growth of the backscatter, RGB [1/m]
  torch::Tensor b_inf;        ///< [3] colour of water without end, RGB
  torch::Tensor ray_lengths;  ///< [H,W] of the rays at unit depth; undefined: one
  torch::Tensor haze;         ///< [1,3,steps,nodes,nodes] lamp_haze_table; undefined: no lamp
};

/// `MediumInput::haze` as the backends look things up in it.
template <typename T>
HazeTable<T> haze_table(const MediumInput& input) {
  if (!input.haze.defined()) return {};
  return {input.haze.data_ptr<T>(), static_cast<int>(input.haze.size(2)),
          static_cast<int>(input.haze.size(3)), static_cast<T>(kLampReach_m)};
}

/// What the light of a lamp is asked for with. Tensors as above.
struct LampInput {
  torch::Tensor means;           ///< [N,3] in the world [m]
  torch::Tensor T_camera_world;  ///< [4,4] float64 on the CPU
  Lamp lamp;
  double unit_range_m = 1.0;
  torch::Tensor beta_d;    ///< [3]
  torch::Tensor daylight;  ///< [3]
};

/// The seam between CPU and CUDA: both take and return the same tensors. Nothing here is recorded
/// by autograd; the one function that is lies above (src/splat/medium.cpp).
class MediumBackend {
 public:
  MediumBackend() = default;
  MediumBackend(const MediumBackend&) = delete;
  MediumBackend& operator=(const MediumBackend&) = delete;
  virtual ~MediumBackend() = default;

  virtual std::string_view name() const = 0;
  /// The image through the water [H,W,3].
  virtual torch::Tensor forward(const MediumInput& input) const = 0;
  /// Derivatives of a loss by color, depth, alpha and, with `by_water`, beta_d, beta_b and b_inf,
  /// from the one by the image [H,W,3]. The haze has none.
  virtual MediumInput backward(const MediumInput& input, const torch::Tensor& grad_image,
                               bool by_water) const = 0;
  /// Light [N,3] on points, see LampLight; by LibTorch's operators unless a backend knows better.
  virtual torch::Tensor lamp_light(const LampInput& input) const;
};

/// cpu_fallback/medium.cpp; float32 and float64, the same bits with any number of threads.
const MediumBackend& cpu_medium_backend();
/// kernels/cuda_backend.cpp, in builds with APVI_BACKEND=cuda.
const MediumBackend& cuda_medium_backend();

/// The backend for tensors on `device`. Throws c10::Error for one this build has no backend for.
const MediumBackend& medium_backend(const torch::Device& device);

}  // namespace apvi::splat
