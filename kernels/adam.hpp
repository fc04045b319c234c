// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

/// Launcher of the optimiser's kernel: pointers to device memory, sizes, a stream, and nothing of
/// LibTorch.
namespace apvi::splat::cuda {

inline constexpr int kMaxAdamGroups = 8;

struct AdamGroupPointers {
  std::int64_t values;
  std::int64_t width;  ///< values of a row, which one mask covers
  float* parameter;
  const float* gradient;
  void* first;   ///< float, or the upper halves of floats (bfloat16)
  void* second;  ///< likewise
  bool cut;      ///< both are halves
  float rate;    ///< with the first moment's bias correction
};

struct AdamFactors {
  float keep_first, keep_second;
  float root_scale;  ///< the second moment's bias correction
  float epsilon;
  unsigned seed;  ///< of the step, for rounding
};

/// One step of all groups in one launch. `visible`, when not null: one a row, which others leave as
/// they are.
cudaError_t launch_adam(const AdamGroupPointers* groups, int count, const AdamFactors& factors,
                        const bool* visible, cudaStream_t stream);

/// Derivatives by those Gaussians of a map that a picture shows; see kRowFloats.
struct GradientRows {
  const std::int32_t* row;  ///< [count] which row; -1: none
  const float* rows;        ///< [.., kRowFloats]
  int sh_degree;            ///< in use
};

/// One step of a map's six kinds of parameters, in the order of Gaussians::tensors(), whose
/// `gradient` is not looked at. `visible_only`: Gaussians without a row stay as they are.
cudaError_t launch_adam_rows(const AdamGroupPointers* groups, std::int64_t count,
                             const GradientRows& gradient, const AdamFactors& factors,
                             bool visible_only, cudaStream_t stream);

}  // namespace apvi::splat::cuda
