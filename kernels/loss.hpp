// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

/// Launchers of the photometric loss's kernels: pointers to device memory, sizes, a stream, and
/// nothing of LibTorch. They return what the launches reported.
namespace apvi::splat::cuda {

/// Maps that the forward pass keeps for the backward pass: the SSIM's derivatives by the mean, by
/// the blurred squares of sum and difference (cpu_fallback/loss_rows.cpp says of what).
inline constexpr int kLossMaps = 3;

struct LossImages {
  int width, height;
  const float* image;   ///< [H,W,3]
  const float* target;  ///< [H,W,3]
  const float* valid;   ///< [H,W] or null: all count
  float ssim_weight;
};

/// Blocks of the forward pass, each of which leaves three partial sums.
std::int64_t loss_blocks(int width, int height);

/// `maps` [kLossMaps,H,W,3], or null when nothing is to be kept; `partials` [blocks,3] scratch;
/// `loss` [1]; `share` [1] one over how many values count.
cudaError_t launch_loss_forward(const LossImages& in, float* maps, float* partials, float* loss,
                                float* share, cudaStream_t stream);
/// `by_loss` [1] is a factor of `gradient` [H,W,3].
cudaError_t launch_loss_backward(const LossImages& in, const float* maps, const float* share,
                                 const float* by_loss, float* gradient, cudaStream_t stream);

}  // namespace apvi::splat::cuda
