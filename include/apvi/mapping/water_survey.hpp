// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "apvi/mapping/depth_options.hpp"
#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/rendering.hpp"
#include "apvi/mapping/water_fit.hpp"

namespace apvi::mapping {

/// What a map and its keyframes tell of the water and of the camera.
struct WaterSurvey {
  std::vector<std::size_t> views;  ///< the keyframes looked at; the fit's gains are theirs
  WaterFit fit;
  bool sees_open_water = false;  ///< which says itself how bright it is
};

/// Looks up surfaces of the map in several keyframes each, from near and from far, and fits the
/// water to what they look like. Each is averaged over a patch of one size in the world, because
/// what blurs with distance would pass for water. `spacing_m` is the least distance between the
/// keyframes used. With a lamp, depth is that of the pictures themselves (`estimate_depth` with
/// these options). Nothing when too little is seen more than twice.
std::optional<WaterSurvey> survey_water(const Map& map, const KeyframeStore& keyframes,
                                        double spacing_m, const WaterPrior& prior,
                                        std::uint64_t seed, const DepthOptions& depth = {});

}  // namespace apvi::mapping
