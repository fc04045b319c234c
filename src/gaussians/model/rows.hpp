// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "gaussians/model/gaussians.hpp"

namespace apvi::gaussians {

/// The same on a device; shares memory if it is there already.
Gaussians on_device(const Gaussians& gaussians, const torch::Device& device);
/// The Gaussians with indices `rows` [n] int64, in that order.
Gaussians select(const Gaussians& gaussians, const torch::Tensor& rows);
/// Those of `a`, then those of `b`; of the same degree, type and device.
Gaussians join(const Gaussians& a, const Gaussians& b);
/// Those of all, in order; of at least one.
Gaussians join(const std::vector<Gaussians>& parts);

}  // namespace apvi::gaussians
