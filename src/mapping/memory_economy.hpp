// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>

#include "apvi/mapping/map_learner.hpp"

namespace apvi::mapping {

/// With fewer Gaussians the map is not what takes the device's memory.
inline constexpr std::int64_t kFewestToShrink = 1000;

/// Does `work`, and once more from its beginning where the device's memory ended in it and
/// `economise` has given something up, at most four times. The error (c10::Error) goes on where
/// that is not enough, or `economise` has nothing to give up (false).
void within_memory(const std::function<void()>& work, const std::function<bool()>& economise);

/// The map goes on with four fifths of its Gaussians, those of most importance, which is the most
/// that it may have from now on, and says so. False, and nothing done, when it is too small for
/// that to help.
bool shrink(MapLearner& learner, int& max_gaussians);

}  // namespace apvi::mapping
