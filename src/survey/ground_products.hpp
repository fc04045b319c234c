// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>

#include "survey/color_rule.hpp"
#include "survey/georeference.hpp"
#include "survey/survey_map.hpp"
#include "survey/terrain_statistics.hpp"

namespace apvi::survey {

/// Called with the finished fraction; may throw to stop.
using Progress = std::function<void(double)>;

/// Changes the heights [H,W] of a tile, NaN where unknown; see HeightFusion.
using HeightRule = std::function<torch::Tensor(const torch::Tensor&, const GroundGrid&)>;

/// A map, where it is written to, and at which resolution.
struct GroundProduct {
  const SurveyMap& map;
  const Georeference& reference;
  GroundGrid grid;
  Progress progress = [](double) {};
  HeightRule heights = [](const torch::Tensor& drawn, const GroundGrid&) { return drawn; };
};

/// GeoTIFF of the map from above: red, green, blue, and alpha. Alpha is 255 where the map is opaque
/// and has a height by the rule of the product, and in gaps of such heights of up to 17 pixels;
/// elsewhere it is 0. Memory is bounded by a tile. Throws RunError.
void write_orthomosaic(const std::filesystem::path& file, const GroundProduct& product,
                       const ColorRule& colors);

/// Elevation model as a GeoTIFF: heights of the surface that an orthomosaic shows [m].
/// Returns the number of pixels with a height. Throws RunError.
std::int64_t write_elevation(const std::filesystem::path& file, const GroundProduct& product);

/// Shape of the ground at the resolution of the product, without writing it.
TerrainStatistics terrain_of(const GroundProduct& product);

}  // namespace apvi::survey
