// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/rendering.hpp"

namespace apvi::mapping {

/// How the color of a surface point depends on the range that it is seen from, per channel: the
/// slope of log color against range [1/m] over all points, each with a color of its own. Without
/// the medium a matte surface has the same color at every range, so the slope of restored colors
/// tells how much of the medium is left (or was removed too much), without any ground truth.
struct RangeBias {
  std::array<double, 3> image{};     ///< of the images as they are
  std::array<double, 3> restored{};  ///< the same with the map's medium removed
  double range_spread_m = 0.0;       ///< root mean square difference from the mean range of a point
  std::int64_t points = 0;
  std::int64_t observations = 0;
};

/// Measures the range bias in the images of `views`, which should not be those that the medium was
/// estimated from; their depth is that of the map. Returns nothing without a medium, with fewer
/// than 50 points in three views, or if ranges differ by less than 3 %.
std::optional<RangeBias> range_bias(const Map& map, const KeyframeStore& keyframes,
                                    const std::vector<std::size_t>& views);

}  // namespace apvi::mapping
