// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

/// Launchers of the optimizer kernels: device pointers, sizes and a stream, without LibTorch.
namespace apvi::gaussians::cuda {

inline constexpr int kMaxAdamGroups = 8;

struct AdamGroupPointers {
  std::int64_t values;
  std::int64_t width;  ///< values per row, covered by one mask element
  float* parameter;
  const float* gradient;
  void* first;   ///< float or bfloat16
  void* second;  ///< likewise
  bool is_bf16;  ///< both moments are bfloat16
  float rate;    ///< learning rate with the first moment's bias correction
};

struct AdamFactors {
  float beta1, beta2;
  float root_scale;  ///< 1 / sqrt(1 - beta2^steps), the second moment's bias correction
  float epsilon;
  unsigned seed;  ///< of this step, for stochastic rounding
};

/// One step of all groups in one launch. `visible`, when not null: one per row; other rows are left
/// unchanged.
cudaError_t launch_adam(const AdamGroupPointers* groups, int count, const AdamFactors& factors,
                        const bool* visible, cudaStream_t stream);

/// Sparse gradient: only for the Gaussians visible in an image; see kRowFloats.
struct SparseGradientPointers {
  const std::int32_t* row;  ///< [count] row of each Gaussian; -1: none
  const float* rows;        ///< [.., kRowFloats]
  int sh_degree;            ///< degree that was rendered
};

/// One step of a map's six kinds of parameters, in the order of Gaussians::tensors(); their
/// `gradient` is ignored. `visible_only`: Gaussians without a row are left unchanged.
cudaError_t launch_adam_sparse(const AdamGroupPointers* groups, std::int64_t count,
                               const SparseGradientPointers& gradient, const AdamFactors& factors,
                               bool visible_only, cudaStream_t stream);

}  // namespace apvi::gaussians::cuda
