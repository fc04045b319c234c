// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

/// Launchers of the photometric loss kernels: device pointers, sizes and a stream, without
/// LibTorch. They return the launch error.
namespace apvi::gaussians::cuda {

/// Maps saved for the backward pass: derivatives of SSIM by the mean and by the blurred squares of
/// sum and difference (see cpu_fallback/loss/loss_kernel.hpp).
inline constexpr int kLossMaps = 3;

struct LossImages {
  int width, height;
  const float* image;   ///< [H,W,3]
  const float* target;  ///< [H,W,3]
  const float* valid;   ///< [H,W] or null: all valid
  float ssim_weight;
};

/// Blocks of the forward pass; each writes three partial sums.
std::int64_t loss_blocks(int width, int height);

/// `maps` [kLossMaps,H,W,3], or null if not needed; `partials` [blocks,3] scratch; `loss` [1];
/// `inv_count` [1] one over the number of valid values.
cudaError_t launch_loss_forward(const LossImages& in, float* maps, float* partials, float* loss,
                                float* inv_count, cudaStream_t stream);
/// `grad_loss` [1] scales `gradient` [H,W,3].
cudaError_t launch_loss_backward(const LossImages& in, const float* maps, const float* inv_count,
                                 const float* grad_loss, float* gradient, cudaStream_t stream);

}  // namespace apvi::gaussians::cuda
