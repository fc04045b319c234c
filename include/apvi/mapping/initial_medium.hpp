// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/splat/gaussians.hpp"
#include "apvi/splat/medium.hpp"

namespace apvi::mapping {

/// A first guess of the water from a few training images and the ranges that the initial map has in
/// them; that of a coast where they tell nothing (see splat::estimate_medium).
splat::Medium initial_medium(const splat::Gaussians& initial, const KeyframeStore& keyframes);

}  // namespace apvi::mapping
