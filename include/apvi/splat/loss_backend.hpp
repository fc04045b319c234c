// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <string_view>

namespace apvi::splat {

/// What the photometric loss compares. All tensors on one device, of one floating type (CUDA:
/// float32), contiguous.
struct LossInput {
  torch::Tensor image;   ///< [H,W,3]
  torch::Tensor target;  ///< [H,W,3]
  torch::Tensor valid;   ///< [H,W] 1 where the pixel counts, 0 where not; undefined: all count
  double ssim_weight = 0.2;
};

struct LossOutput {
  torch::Tensor loss;  ///< [] of the images' type
  /// What `backward` wants to have kept, in a shape of the backend's own; undefined unless asked
  /// for.
  torch::Tensor kept;
};

/// The seam between CPU and CUDA: both take and return the same tensors. Nothing here is recorded
/// by autograd; the one function that is lies above (src/splat/losses.cpp).
class LossBackend {
 public:
  LossBackend() = default;
  LossBackend(const LossBackend&) = delete;
  LossBackend& operator=(const LossBackend&) = delete;
  virtual ~LossBackend() = default;

  virtual std::string_view name() const = 0;
  virtual LossOutput forward(const LossInput& input, bool keep_for_backward) const = 0;
  /// Derivative by the image [H,W,3] of what has the derivative `by_loss` [] by the loss.
  virtual torch::Tensor backward(const LossInput& input, const torch::Tensor& kept,
                                 const torch::Tensor& by_loss) const = 0;
};

/// cpu_fallback/loss.cpp; float32 and float64, the same bits with any number of threads.
const LossBackend& cpu_loss_backend();

/// kernels/cuda_backend.cpp, in builds with APVI_BACKEND=cuda; float32.
const LossBackend& cuda_loss_backend();

/// The backend for tensors on `device`. Throws c10::Error for one this build has no backend for.
const LossBackend& loss_backend(const torch::Device& device);

}  // namespace apvi::splat
