// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/rendering.hpp"

namespace apvi::mapping {

/// Changes the colours of `map`, in place, so that through the water and the camera of `after` it
/// looks to its keyframes as it looks now through its own: for each Gaussian and channel the best
/// colour over the keyframes that have it in view. What depends on direction changes alike.
/// `after.gaussians` is not looked at.
void recolor(const Map& map, const Map& after, const KeyframeStore& keyframes);

}  // namespace apvi::mapping
