// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/random.hpp"
#include "gaussians/model/gaussians.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/rendering.hpp"

namespace apvi::mapping {

/// Creates `count` small Gaussians at random pixels of a keyframe in the pixels' colors, on the
/// map's device. Their depth is the map's, or where it has none near that of a random mapped pixel
/// (Matsuki et al., "Gaussian splatting SLAM", 2024, use the median), or without any depth uniform
/// between `extent` / 10 and `extent` [m].
gaussians::Gaussians random_gaussians(const Map& map, const KeyframeStore& keyframes,
                                      std::size_t view, std::int64_t count, double extent,
                                      Random& random);

}  // namespace apvi::mapping
