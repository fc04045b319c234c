// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace apvi::mapping {

/// How the depths that are tried lie between the nearest and the farthest.
enum class DepthSpacing {
  inverse_depth,  ///< equal steps of 1/depth, so nearly equal steps in the other pictures
  linear_depth,   ///< equal steps of depth, as the paper prints
};

/// How a piece of one picture is compared with a piece of another.
enum class PhotometricCost {
  zncc,      ///< one minus the correlation of the two: blind to gain and offset
  absolute,  ///< mean absolute difference, as the paper prints; water is taken into account
};

struct QuadtreeOptions {
  int largest_px = 16;              ///< side of the blocks that the image is first divided into
  int smallest_px = 4;              ///< blocks of this side are not divided any more
  double threshold = 10.0 / 255.0;  ///< a block is whole while no pixel is farther from its mean
};

/// Belief propagation with the truncated linear model: neighbours that differ by n hypotheses cost
/// min(n * step, limit).
struct BeliefOptions {
  bool enabled = true;
  int iterations = 12;
  double step = 0.02;
  double limit = 0.15;
  double edge_sigma = 20.0 / 255.0;  ///< neighbours that differ by this in intensity matter 1/e
};

/// The edge-aware smoother that spreads the blocks' depths over the image.
struct UpsampleOptions {
  double lambda = 20.0;         ///< larger: smoother
  double sigma = 12.0 / 255.0;  ///< an intensity step of this lets 1/e through
  int iterations = 3;
};

/// Which depths are believed.
struct ConfidenceOptions {
  double least = 0.5;            ///< confidence from which a block counts as confident
  double good_cost = 0.4;        ///< photometric cost at which half of the trust is gone
  double uniqueness = 0.15;      ///< cost by which the second best place must be worse
  double match_sigma_px = 0.5;   ///< how well a block is found in another picture, one sigma
  double neighbors = 0.9;        ///< part of the neighbours that must lie on the same surface
  double relative_sigma = 0.05;  ///< depth known worse than to this part is not believed
};

struct DepthOptions {
  double near_m = 0.10;
  double far_m = 25.0;
  int hypotheses = 128;
  DepthSpacing spacing = DepthSpacing::inverse_depth;
  /// Whether a sweep of the largest blocks first finds the depths that occur, so that all
  /// hypotheses lie there.
  bool adapt_range = true;
  int views = 10;           ///< at most so many pictures are compared, the reference among them
  double best_share = 0.5;  ///< of those that see a point: so many count, those that fit best
  PhotometricCost cost = PhotometricCost::zncc;
  double noise = 0.5 / 255.0;  ///< of an intensity; contrast below it says little
  /// A pixel of a patch that differs by this in intensity from its middle counts 1/e, or by the
  /// patch's standard deviation if that is more: it may be of another surface.
  double patch_sigma = 10.0 / 255.0;
  QuadtreeOptions quadtree;
  BeliefOptions belief;
  UpsampleOptions upsample;
  ConfidenceOptions confidence;
};

}  // namespace apvi::mapping
