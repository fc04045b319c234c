// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <vector>

#include "gaussians/model/gaussians.hpp"
#include "gaussians/render/view.hpp"

namespace apvi::mapping {

/// Two maps of one frame put together.
struct MapUnion {
  gaussians::Gaussians gaussians;  ///< in the colors of the first map
  /// [3] colors of the second map relative to the first one's where both show the same surface, the
  /// median; ones where they share none.
  torch::Tensor light;
  std::int64_t added = 0;  ///< Gaussians of the second map
};

/// All Gaussians of `map` and those of `other` that fill its gaps: where most of the `views` of the
/// second map that show a Gaussian find no surface of the first one there, a thinner one, or a
/// farther one. Gaussians that no view shows are left out. Both on the device that renders; the
/// result has the higher degree of spherical harmonics.
MapUnion unite(const gaussians::Gaussians& map, const gaussians::Gaussians& other,
               const std::vector<gaussians::View>& views);

}  // namespace apvi::mapping
