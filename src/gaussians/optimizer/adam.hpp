// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <vector>

#include "gaussians/model/gaussians.hpp"

namespace apvi::gaussians {

/// Kingma and Ba, "Adam: a method for stochastic optimization", 2015, with bias correction. The
/// small epsilon is that of Gaussian splatting: gradients averaged over pixels are tiny.
struct AdamOptions {
  double beta1 = 0.9;
  double beta2 = 0.999;
  double epsilon = 1e-15;
};

/// Parameters with one learning rate and their moments; all of one shape, one floating type (except
/// moments, see `moment_type`) and one device, contiguous.
struct AdamGroup {
  torch::Tensor parameter;
  torch::Tensor gradient;  ///< undefined: the group and its moments are left unchanged
  torch::Tensor first;     ///< first moment: mean of the gradient
  torch::Tensor second;    ///< second moment: mean of the squared gradient
  double rate = 0.0;
};

/// Preferred type of a parameter's moments: bfloat16 for float32 on a GPU, where a step is limited
/// by memory bandwidth; otherwise the type of the parameter, which the GPU supports too. Moments in
/// 16 bits are rounded stochastically to stay unbiased.
torch::ScalarType moment_type(const torch::Tensor& parameter);

/// One step of every group, in place. `steps` counts this step: 1 for the first. `visible` [N]
/// bool, when defined: only these rows of the [N,...] groups and their moments are updated (sparse
/// Adam), which is cheaper and avoids drift of unobserved rows on old momentum. Throws c10::Error
/// for mismatched shapes, types or devices.
void adam_step(const std::vector<AdamGroup>& groups, std::int64_t steps,
               const AdamOptions& options = {}, const torch::Tensor& visible = {});

/// The same for a whole map: six groups in the order of Gaussians::tensors(); their `gradient`
/// members are ignored in favor of the sparse `gradient`. `visible_only`: Gaussians without a
/// gradient are left unchanged. Throws c10::Error when the backend does not support sparse
/// gradients.
void adam_step_sparse(const std::vector<AdamGroup>& groups, const SparseGradient& gradient,
                      std::int64_t steps, const AdamOptions& options = {},
                      bool visible_only = false);

}  // namespace apvi::gaussians
