// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <vector>

#include "apvi/mapping/water_fit.hpp"
#include "apvi/splat/view.hpp"

namespace apvi::mapping {

/// Where views may show open water: even places that the map leaves empty, which may be surfaces
/// that it does not have yet, and such above the horizon, which it may have hidden behind
/// Gaussians of the water's colour.
class EmptyPlaces {
 public:
  /// Of a `picture` [H,W,3] that the map covers by `alpha` [H,W], both on one device. `number` is
  /// the view's.
  void add(std::int64_t number, const splat::View& camera, const torch::Tensor& picture,
           const torch::Tensor& alpha);

  /// Those that look like one water in daylight, which is about that of `fit`: as sightings from
  /// afar, a point each, without what is for a lamp. No points when most do not, or too few do.
  /// Above the horizon if there are enough: below it, far sand in the haze is nearly of that
  /// colour.
  Sightings open_water(const WaterFit& fit) const;

 private:
  std::vector<torch::Tensor> views_, corners2_, colors_, bare_, above_;
};

}  // namespace apvi::mapping
