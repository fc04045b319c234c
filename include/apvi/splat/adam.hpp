// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <vector>

#include "apvi/splat/gaussians.hpp"

namespace apvi::splat {

/// Kingma and Ba, "Adam: a method for stochastic optimization", 2015, with its bias correction. The
/// tiny epsilon is that of Gaussian splatting: gradients of means over pixels are tiny themselves.
struct AdamOptions {
  double beta1 = 0.9;
  double beta2 = 0.999;
  double epsilon = 1e-15;
};

/// Parameters that learn at one rate, with their moments; all of one shape, one floating type (but
/// for moments, see `moment_type`) and one device, contiguous.
struct AdamGroup {
  torch::Tensor parameter;
  torch::Tensor gradient;  ///< undefined: the group stays as it is, moments too
  torch::Tensor first;     ///< mean of the gradient
  torch::Tensor second;    ///< mean of its square
  double rate = 0.0;
};

/// In what moments of a parameter are best kept: bfloat16 for float32 on a GPU, where a step takes
/// as long as memory needs to be read and written; otherwise the parameter's type, which a GPU
/// takes too. Moments cut to 16 bits are rounded at random, so that their means are right.
torch::ScalarType moment_type(const torch::Tensor& parameter);

/// One step of every group, in place. `steps` counts this one too: it is 1 at the first. `visible`
/// [N] bool, when defined: only those rows of the [N,...] groups change, their moments too; then a
/// step costs less and rows that no view sees do not drift on old momentum (by default they do, as
/// Adam says). Throws c10::Error when shapes, types or devices do not fit.
void adam_step(const std::vector<AdamGroup>& groups, std::int64_t steps,
               const AdamOptions& options = {}, const torch::Tensor& visible = {});

/// The same for a whole map: six groups in the order of Gaussians::tensors(), whose gradients are
/// not looked at, but those in `rows`. `visible_only`: Gaussians without a row stay as they are.
/// Throws c10::Error when the backend of their device has no rows.
void adam_step_rows(const std::vector<AdamGroup>& groups, const GaussianRows& rows,
                    std::int64_t steps, const AdamOptions& options = {}, bool visible_only = false);

}  // namespace apvi::splat
