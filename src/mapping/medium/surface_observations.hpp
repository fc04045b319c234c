// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/random.hpp"
#include "gaussians/render/view.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/rendering.hpp"
#include "medium/medium_fit.hpp"

namespace apvi::mapping {

/// A keyframe with its surface points, at a reduced size.
struct SampledView {
  std::size_t keyframe = 0;
  std::size_t cluster = 0;
  gaussians::View camera;
  torch::Tensor alpha;           ///< [H,W]
  torch::Tensor depth;           ///< [H,W] float64 on the CPU, 0 where unknown
  torch::Tensor points;          ///< [p,3] float64 in the world frame
  torch::Tensor normals;         ///< [p,3] surface normals
  torch::Tensor smooth_normals;  ///< [p,3] the same over a larger neighborhood, for a lamp
};

/// Reduction of the images in which surfaces are observed.
int observation_reduction(const gaussians::Intrinsics& camera);

/// Renders keyframe `i`; without points.
SampledView sample_view(const Map& map, const KeyframeStore& keyframes, std::size_t i,
                        std::size_t cluster);

/// Chooses random surface points of the view, with normals; at most `count`.
void sample_points(SampledView& view, std::int64_t count, bool with_lamp, Random& random);

/// Standard deviation of a patch of the surface [m] that is large enough in the most distant views.
double patch_size(const std::vector<SampledView>& views);

/// Collects the colors of surface points in several views. They are means over patches of
/// `patch_m` on the surface.
class ObservationCollector {
 public:
  /// Colors are the light that the images show with this tone curve.
  ObservationCollector(const KeyframeStore& keyframes, const gaussians::ToneCurve& curve,
                       const torch::Device& device, double patch_m)
      : keyframes_(keyframes), curve_(curve), device_(device), patch_m_(patch_m) {}

  /// `numbers` [p] int64 are indices of the points [p,3], with surface normals and smoothed
  /// normals.
  void add(const SampledView& view, std::int64_t number, const torch::Tensor& points,
           const torch::Tensor& normals, const torch::Tensor& smooth_normals,
           const torch::Tensor& numbers);

  /// Observations of points with at least three views, reindexed.
  medium::Observations observations(std::int64_t point_count, std::int64_t view_count) const;

 private:
  const KeyframeStore& keyframes_;
  gaussians::ToneCurve curve_;
  torch::Device device_;
  double patch_m_;
  std::vector<torch::Tensor> points_, views_, ranges_, corners2_, colors_, slopes_, texture_,
      places_, normals_;
};

}  // namespace apvi::mapping
