// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/config/fields.hpp"

namespace apvi::depth {

/// Spacing of the depth hypotheses.
enum class DepthSpacing {
  inverse_depth,  ///< uniform in 1/depth, so nearly uniform in the other images
  linear_depth,   ///< uniform in depth, as in the paper
};

/// Photometric cost of two patches.
enum class PhotometricCost {
  zncc,      ///< 1 - zero-mean normalized cross-correlation: invariant to gain and offset
  absolute,  ///< mean absolute difference, as in the paper
};

/// Pixel whose depth is the depth of a block, and at which a Gaussian is added.
enum class BlockRepresentative {
  center,
  top_left,  ///< as in the paper
};

struct QuadtreeOptions {
  int max_block_px = 16;                  ///< side of the root blocks
  int min_block_px = 4;                   ///< side of the smallest blocks
  double split_threshold = 10.0 / 255.0;  ///< maximum deviation of a pixel from the block's mean
  BlockRepresentative representative = BlockRepresentative::center;

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    v("max_block_px", max_block_px, Range{2, 128},
      "side of the largest blocks, a power of two [px]");
    v("min_block_px", min_block_px, Range{2, 128},
      "side of the smallest blocks; if it does not divide the largest, the last split leaves "
      "narrower blocks (6 as in the paper: 16, 8, 6 and 2) [px]");
    v("split_threshold", split_threshold, Range{0.0, 1.0},
      "a block is split if a pixel differs by more than this from its mean intensity (0 to 1)");
    v("representative", representative,
      Choices<BlockRepresentative>{{"center", BlockRepresentative::center},
                                   {"top_left", BlockRepresentative::top_left}},
      "point of a block at which depth is estimated and a Gaussian is added: its center, or its "
      "top-left pixel (the paper)");
  }
};

/// Belief propagation with the truncated linear model: neighbors n hypotheses apart cost min(n *
/// cost_per_step, max_cost).
struct BeliefPropagationOptions {
  bool enabled = true;
  int iterations = 12;
  double cost_per_step = 0.02;
  double max_cost = 0.15;
  double edge_sigma = 20.0 / 255.0;  ///< intensity difference at which the cost falls to 1/e

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "smooth depth by belief propagation");
    v("iterations", iterations, Range{0, 1000}, "number of iterations");
    v("cost_per_step", cost_per_step, Range{0.0, 10.0},
      "smoothness cost per hypothesis that neighbors differ by");
    v("max_cost", max_cost, Range{0.0, 10.0}, "maximum smoothness cost (truncated linear model)");
    v("edge_sigma", edge_sigma, Range{1e-3, 1e3},
      "difference of mean intensity (0 to 1) at which the smoothness weight is 1/e");
  }
};

/// Edge-aware upsampling of the blocks' depths to the image.
struct UpsampleOptions {
  double lambda = 20.0;         ///< larger: smoother
  double sigma = 12.0 / 255.0;  ///< intensity difference at which smoothing falls to 1/e
  int iterations = 3;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("lambda", lambda, Range{0.0, 1e9}, "smoothness weight");
    v("sigma", sigma, Range{1e-4, 1e3},
      "intensity difference (0 to 1) at which the smoothness weight is 1/e");
    v("iterations", iterations, Range{1, 10}, "number of iterations");
  }
};

/// Confidence of depths.
struct ConfidenceOptions {
  double min_confidence = 0.5;        ///< of a confident block
  double half_confidence_cost = 0.4;  ///< photometric cost at a confidence factor of one half
  double uniqueness_margin = 0.15;    ///< minimum cost margin of the second-best minimum
  double match_sigma_px = 0.5;        ///< standard deviation of a match in another image
  double neighbor_fraction = 0.9;     ///< required fraction of neighbors on the same surface
  double max_relative_sigma = 0.05;   ///< relative uncertainty at which confidence starts to fall

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("min_confidence", min_confidence, Range{0.0, 1.0}, "minimum confidence of a block's depth");
    v("half_confidence_cost", half_confidence_cost, Range{0.0, 1.0},
      "photometric cost at which the confidence is halved");
    v("uniqueness_margin", uniqueness_margin, Range{1e-6, 1.0},
      "cost margin to the best depth elsewhere at full confidence");
    v("neighbor_fraction", neighbor_fraction, Range{1e-6, 1.0},
      "minimum fraction of neighbors on the same surface");
    v("match_sigma_px", match_sigma_px, Range{1e-3, 100.0},
      "matching accuracy in another image, one sigma [px]");
    v("max_relative_sigma", max_relative_sigma, Range{1e-4, 10.0},
      "maximum relative depth uncertainty from parallax, one sigma");
  }
};

struct DepthOptions {
  double min_depth_m = 0.10;
  double max_depth_m = 25.0;
  int hypotheses = 128;
  DepthSpacing spacing = DepthSpacing::inverse_depth;
  /// Whether a coarse sweep of the largest blocks first restricts the depth range of the
  /// hypotheses.
  bool adapt_range = true;
  int views = 10;  ///< maximum number of images, including the reference
  double best_views_fraction =
      0.5;  ///< fraction of the observing images, the best-matching, that is averaged
  PhotometricCost cost = PhotometricCost::zncc;
  bool compensate_medium = true;         ///< by PhotometricCost::absolute
  double intensity_sigma = 0.5 / 255.0;  ///< intensity noise; contrast below it is uninformative
  /// Intensity difference from the patch center at which a pixel's weight falls to 1/e, or the
  /// patch's standard deviation if larger: it may belong to another surface.
  double patch_intensity_sigma = 10.0 / 255.0;
  QuadtreeOptions quadtree;
  BeliefPropagationOptions belief_propagation;
  UpsampleOptions upsample;
  ConfidenceOptions confidence;

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    v("min_depth_m", min_depth_m, Range{1e-3, 1e4}, "minimum depth [m]");
    v("max_depth_m", max_depth_m, Range{1e-3, 1e6}, "maximum depth [m]");
    v("hypotheses", hypotheses, Range{8, 1024}, "number of depth hypotheses");
    v("spacing", spacing,
      Choices<DepthSpacing>{{"inverse_depth", DepthSpacing::inverse_depth},
                            {"linear_depth", DepthSpacing::linear_depth}},
      "hypotheses equally spaced in inverse depth, or in depth (the paper)");
    v("adapt_range", adapt_range, "narrow the depth range by a coarse search first");
    v("views", views, Range{2, 32}, "number of images compared, including the keyframe");
    v("best_views_fraction", best_views_fraction, Range{0.01, 1.0},
      "fraction of the views of a point that count, best match first, as others may be occluded; "
      "1: all (the paper, and always with a lamp)");
    v("cost", cost,
      Choices<PhotometricCost>{{"zncc", PhotometricCost::zncc},
                               {"absolute", PhotometricCost::absolute}},
      "zncc: normalized cross-correlation; absolute: absolute difference of intensities (the "
      "paper)");
    v("compensate_medium", compensate_medium,
      "cost absolute: compare intensities as the medium changes them; false: as they are (the "
      "paper)");
    v("intensity_sigma", intensity_sigma, Range{0.0, 1.0},
      "intensity noise (0 to 1), one sigma; the default is half a gray level of 8 bits, 0.5/255");
    v("patch_intensity_sigma", patch_intensity_sigma, Range{1e-3, 1e3},
      "bilateral weight of patch pixels: intensity difference (0 to 1) to the center at which it "
      "is 1/e, at least the patch's standard deviation; 1000: uniform (the paper, and always with "
      "a lamp)");
    v("quadtree", quadtree, "quadtree of blocks");
    v("belief_propagation", belief_propagation, "belief propagation between blocks");
    v("upsample", upsample, "edge-aware upsampling from blocks to pixels (fast global smoother)");
    v("confidence", confidence, "confidence of depths");
  }
};

}  // namespace apvi::depth
