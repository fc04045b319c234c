// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <vector>

#include "apvi/mapping/water_fit.hpp"
#include "apvi/splat/view.hpp"

namespace apvi::mapping {

/// Where views show nothing that the map knows: open water, or surfaces that it does not have yet.
class EmptyPlaces {
 public:
  /// Of a `picture` [H,W,3] that the map covers by `alpha` [H,W], both on one device. `number` is
  /// the view's.
  void add(std::int64_t number, const splat::View& camera, const torch::Tensor& picture,
           const torch::Tensor& alpha);

  /// Those that look like one water in daylight, which is about that of `fit`: as sightings from
  /// afar, a point each, without what is for a lamp. No points when most do not, or too few do.
  Sightings open_water(const WaterFit& fit) const;

 private:
  std::vector<torch::Tensor> views_, corners2_, colors_;
};

}  // namespace apvi::mapping
