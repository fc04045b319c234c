// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/config/fields.hpp"
#include "apvi/mapping/depth_options.hpp"

namespace apvi::bridge {

// The words of a configuration file for the options of depth estimation.

struct QuadtreeSection : mapping::QuadtreeOptions {
  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("largest_px", largest_px, Range{2, 128}, "side of the largest blocks, a power of two [px]");
    v("smallest_px", smallest_px, Range{2, 128}, "side of the smallest, a power of two [px]");
    v("threshold", threshold, Range{0.0, 1.0},
      "a block is whole while no pixel is farther from its mean intensity (0 to 1)");
  }
};

struct BeliefSection : mapping::BeliefOptions {
  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "whether neighbouring blocks are made to agree");
    v("iterations", iterations, Range{0, 1000}, "each carries a message one block further");
    v("step", step, Range{0.0, 10.0}, "cost of neighbours one hypothesis apart, per hypothesis");
    v("limit", limit, Range{0.0, 10.0}, "cost of neighbours any number of hypotheses apart");
    v("edge_sigma", edge_sigma, Range{1e-3, 1e3},
      "neighbours that differ by this in mean intensity (0 to 1) matter 1/e");
  }
};

struct UpsampleSection : mapping::UpsampleOptions {
  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("lambda", lambda, Range{0.0, 1e9}, "larger: smoother");
    v("sigma", sigma, Range{1e-4, 1e3}, "an intensity step of this (0 to 1) lets 1/e through");
    v("iterations", iterations, Range{1, 10}, "passes over rows and columns");
  }
};

struct ConfidenceSection : mapping::ConfidenceOptions {
  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("least", least, Range{0.0, 1.0}, "confidence from which a block's depth is believed");
    v("good_cost", good_cost, Range{0.0, 1.0}, "photometric cost at which half the trust is gone");
    v("uniqueness", uniqueness, Range{1e-6, 1.0},
      "how much worse the best depth elsewhere must look");
    v("neighbors", neighbors, Range{1e-6, 1.0},
      "part of the neighbours that must lie on the same surface");
    v("match_sigma_px", match_sigma_px, Range{1e-3, 100.0},
      "how well a block is found in another picture, one sigma [px]");
    v("relative_sigma", relative_sigma, Range{1e-4, 10.0},
      "depth that parallax gives worse than to this part is not believed");
  }
};

/// Options of depth estimation, as in a configuration file.
struct DepthSection {
  mapping::DepthOptions values;  // the single ones; its groups are the sections below
  QuadtreeSection quadtree;
  BeliefSection belief;
  UpsampleSection upsample;
  ConfidenceSection confidence;

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    using mapping::DepthSpacing;
    using mapping::PhotometricCost;
    v("near_m", values.near_m, Range{1e-3, 1e4}, "nearest depth looked for [m]");
    v("far_m", values.far_m, Range{1e-3, 1e6}, "farthest depth looked for [m]");
    v("hypotheses", values.hypotheses, Range{8, 1024}, "depths tried between the two");
    v("spacing", values.spacing,
      Choices<DepthSpacing>{{"inverse_depth", DepthSpacing::inverse_depth},
                            {"linear_depth", DepthSpacing::linear_depth}},
      "equal steps of 1/depth, or of depth as the paper prints");
    v("adapt_range", values.adapt_range,
      "whether a first, coarse look narrows the range, so that the steps become finer");
    v("views", values.views, Range{2, 32}, "pictures compared, the keyframe among them");
    v("best_share", values.best_share, Range{0.01, 1.0},
      "of the pictures that see a point, those that fit best count: in the others it "
      "may be hidden; 1: all, as the paper prints, and as new Gaussians have it by lamplight");
    v("cost", values.cost,
      Choices<PhotometricCost>{{"zncc", PhotometricCost::zncc},
                               {"absolute", PhotometricCost::absolute}},
      "correlation, or absolute difference of intensities through the water, as the paper prints");
    v("noise", values.noise, Range{0.0, 1.0}, "of intensities (0 to 1), one sigma");
    v("patch_sigma", values.patch_sigma, Range{1e-3, 1e3},
      "pixels that differ by this in intensity (0 to 1) from the middle of what is "
      "compared, and by its standard deviation, matter 1/e; 1000: all alike, as the paper "
      "prints, and as new Gaussians have it by lamplight");
    v("quadtree", quadtree, "the blocks whose depth is estimated");
    v("belief", belief, "belief propagation");
    v("upsample", upsample, "from blocks to pixels");
    v("confidence", confidence, "which depths are believed");
  }

  mapping::DepthOptions options() const {
    mapping::DepthOptions out = values;
    out.quadtree = quadtree;
    out.belief = belief;
    out.upsample = upsample;
    out.confidence = confidence;
    return out;
  }
};

}  // namespace apvi::bridge
