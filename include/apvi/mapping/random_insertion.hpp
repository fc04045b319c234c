// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>

#include "apvi/core/random.hpp"
#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/rendering.hpp"
#include "apvi/splat/gaussians.hpp"

namespace apvi::mapping {

/// Small Gaussians behind random pixels of a keyframe, in the pixels' colours: at the depth that
/// the map has there; where it has none, at about that of a random pixel that has one (after
/// Matsuki et al., "Gaussian splatting SLAM", 2024, who take the median); and in a picture without
/// any depth at one from a tenth of `extent` to all of it [m]. As many as asked for, on the map's
/// device.
splat::Gaussians random_gaussians(const Map& map, const KeyframeStore& keyframes, std::size_t view,
                                  std::int64_t count, double extent, Random& random);

}  // namespace apvi::mapping
