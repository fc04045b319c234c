// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>

#include "apvi/mapping/options.hpp"
#include "depth/depth.hpp"
#include "mapping/alignment/keyframe_poses.hpp"
#include "mapping/density/seeds.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace apvi::mapping {

/// Estimates the depth of a keyframe by quadtree, and seeds where the map does not show what was
/// seen.
class DepthSeeder {
 public:
  explicit DepthSeeder(const MapperOptions& options);

  /// The keyframe and its neighbors, as input of `estimate`.
  depth::DepthRequest request(std::size_t view, const KeyframeStore& keyframes,
                              const KeyframePoses& poses, const MapOptimizer& optimizer) const;
  /// No block with a pixel that is not `scene` [H,W] bool is confident; undefined: all are.
  depth::DepthEstimate estimate(const depth::DepthRequest& request, const torch::Tensor& scene);
  /// In daylight, removes the Gaussians in front of the surfaces that the keyframe sees.
  void clear_free_space(const depth::DepthEstimate& estimate, const gaussians::View& camera,
                        MapOptimizer& optimizer) const;
  /// Seeds of the blocks that the map does not cover, that contain none of `points` [n,3] float64
  /// [m], and that show nothing that moves (see RobustWeights).
  Seeds seeds(const depth::DepthEstimate& estimate, std::size_t view,
              const KeyframeStore& keyframes, const MapOptimizer& optimizer,
              const torch::Tensor& points) const;

  /// Time spent in `estimate` so far [s].
  double estimation_s() const { return estimation_s_; }

 private:
  depth::DepthOptions depth_;
  OnlineOptions options_;
  bool clears_free_space_;
  double estimation_s_ = 0.0;
};

}  // namespace apvi::mapping
