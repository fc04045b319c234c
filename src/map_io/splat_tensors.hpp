// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "gaussians/model/gaussians.hpp"
#include "map_io/splats.hpp"

namespace apvi::map_io {

/// Copies to tensors, float32 on the CPU, and back.
gaussians::Gaussians to_gaussians(const Splats& splats);
Splats to_splats(const gaussians::Gaussians& gaussians);

}  // namespace apvi::map_io
