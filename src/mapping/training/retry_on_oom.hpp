// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>

#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace apvi::mapping {

/// Smaller maps are not shrunk: other data uses the device memory.
inline constexpr std::int64_t kMinGaussiansToShrink = 1000;

/// Runs `work`. When the device runs out of memory, calls `reduce_memory` and runs `work` again
/// from its beginning, at most four times; `work` must tolerate partial execution. Rethrows the
/// c10::Error when that is not enough or `reduce_memory` returns false (nothing to free).
void retry_on_oom(const std::function<void()>& work, const std::function<bool()>& reduce_memory);

/// The same for a growing map: moves the images of its keyframes to the host first, which costs
/// only time, and then shrinks the map.
void retry_on_oom(const std::function<void()>& work, MapOptimizer& optimizer,
                  KeyframeStore& keyframes);

/// Reduces the map to its 80 % most important Gaussians, which is the limit from then on, and logs
/// a warning. Returns false and does nothing for maps below kMinGaussiansToShrink.
bool shrink_map(MapOptimizer& optimizer);

}  // namespace apvi::mapping
