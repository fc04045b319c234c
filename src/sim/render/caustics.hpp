// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "sim/render/light.hpp"
#include "sim/world/noise_texture.hpp"

namespace apvi::sim {

/// Factor on the direct sunlight at points under a wavy surface, mean about 1. All lanes of `p` are
/// read, used or not. Without caustics all factors are 1.
void caustics(const LightConfig& light, double time_s, const Points& p, Lanes& out);

}  // namespace apvi::sim
