// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "gaussians/model/gaussians.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "medium/medium.hpp"

namespace apvi::mapping {

/// Initial medium from a few training images and the ranges of the initial map; coastal water where
/// these contain no information (see medium::initialize_medium).
medium::Medium initial_medium(const gaussians::Gaussians& initial, const KeyframeStore& keyframes);

}  // namespace apvi::mapping
