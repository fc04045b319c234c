// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <string_view>

namespace apvi::gaussians {

/// Inputs of the photometric loss. All tensors on one device, of one floating type (CUDA: float32),
/// contiguous.
struct LossInput {
  torch::Tensor image;   ///< [H,W,3]
  torch::Tensor target;  ///< [H,W,3]
  torch::Tensor valid;   ///< [H,W] 1 for valid pixels, else 0; undefined: all valid
  double ssim_weight = 0.2;
};

struct LossOutput {
  torch::Tensor loss;  ///< [], type of the images
  /// State for `backward`, in a backend-specific form; undefined unless requested.
  torch::Tensor saved;
};

/// Interface of the CPU and CUDA implementations: both take and return the same tensors. Not
/// recorded by autograd; src/gaussians/metrics/losses.cpp wraps it in an autograd function.
class LossBackend {
 public:
  LossBackend() = default;
  LossBackend(const LossBackend&) = delete;
  LossBackend& operator=(const LossBackend&) = delete;
  virtual ~LossBackend() = default;

  virtual std::string_view name() const = 0;
  virtual LossOutput forward(const LossInput& input, bool needs_backward) const = 0;
  /// Gradient with respect to the image [H,W,3], given the upstream gradient `grad_loss` [].
  virtual torch::Tensor backward(const LossInput& input, const torch::Tensor& saved,
                                 const torch::Tensor& grad_loss) const = 0;
};

/// cpu_fallback/loss/loss.cpp; float32 and float64, bitwise identical for any number of threads.
const LossBackend& cpu_loss_backend();

/// kernels/loss/cuda_loss.cpp, in builds with APVI_BACKEND=cuda; float32.
const LossBackend& cuda_loss_backend();

/// The backend for tensors on `device`. Throws c10::Error if this build has none.
const LossBackend& loss_backend(const torch::Device& device);

}  // namespace apvi::gaussians
