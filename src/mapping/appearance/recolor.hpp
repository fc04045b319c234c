// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/rendering.hpp"

namespace apvi::mapping {

/// Changes the colors of `map` in place, so that with the medium and camera response of `after` its
/// keyframe renderings stay the same: a least-squares color per Gaussian and channel over the
/// keyframes `views` that see it. View-dependent coefficients are scaled alike. `after.gaussians`
/// is not used.
void recolor(const Map& map, const Map& after, const KeyframeStore& keyframes,
             const std::vector<std::size_t>& views);

/// The keyframes that Gaussians are anchored to, from `anchors` [n] int64; all training keyframes
/// if there are none.
std::vector<std::size_t> anchor_views(const torch::Tensor& anchors, const KeyframeStore& keyframes);

}  // namespace apvi::mapping
