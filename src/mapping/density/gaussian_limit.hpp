// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/mapping/options.hpp"

namespace apvi::mapping {

/// `max_gaussians`, or the default of the active device where it is 0.
int gaussian_limit(const DensifyOptions& options);

}  // namespace apvi::mapping
