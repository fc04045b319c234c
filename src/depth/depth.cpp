// SPDX-License-Identifier: BSD-3-Clause
#include "depth/depth.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include "depth/depth_backend.hpp"
#include "depth/depth_confidence.hpp"
#include "depth/depth_geometry.hpp"

namespace apvi::depth {
namespace {

using torch::Tensor;

constexpr double kMinContrast = 3.0 / 255.0;  // standard deviation of intensity
constexpr double kMinBaseline_m = 1e-4;
constexpr int kRangeLevel = 2;             // pyramid level of the range search
constexpr double kRangeTail = 0.01;        // fraction of blocks outside, at either end
constexpr double kRangeNearFactor = 1.25;  // margin at the near end
constexpr double kRangeFarFactor =
    2.5;  // margin at the far end; larger, as few blocks may see a distant background
constexpr std::size_t kMinBlocksForRange = 20;
constexpr int kRefinements = 2;
constexpr std::int64_t kRefinementSteps = 4;   // per step of the last round, to either side
constexpr double kMaxSlope = 0.02;             // relative change of 1/depth of a surface [1/px]
constexpr double kMaxSurfaceDifference = 0.1;  // relative difference of 1/depth within a surface
constexpr double kExcludedCost = 1e9;
constexpr double kMinimumHalfWidth_px = 2.0;   // of a cost minimum, in the other images
constexpr std::int64_t kMinimumHalfWidth = 3;  // of a cost minimum, in hypotheses

/// The part of a block whose center represents it.
Block represented(Block block, BlockRepresentative where) {
  if (where == BlockRepresentative::top_left) block.width = block.height = 1;
  return block;
}

Tensor points_of(const std::vector<Block>& blocks, BlockRepresentative where) {
  Tensor points = torch::empty({static_cast<std::int64_t>(blocks.size()), 2}, torch::kFloat32);
  auto* p = points.data_ptr<float>();
  for (const Block& block : blocks) {
    const Block b = represented(block, where);
    *p++ = static_cast<float>(b.x) + 0.5F * static_cast<float>(b.width);
    *p++ = static_cast<float>(b.y) + 0.5F * static_cast<float>(b.height);
  }
  return points;
}

/// Regular grid of blocks, row by row, without intensities; cut off at the border.
std::vector<Block> grid_of(int width, int height, int side) {
  std::vector<Block> blocks;
  for (int y = 0; y < height; y += side) {
    for (int x = 0; x < width; x += side) {
      blocks.push_back({.x = x,
                        .y = y,
                        .size = side,
                        .width = std::min(side, width - x),
                        .height = std::min(side, height - y)});
    }
  }
  return blocks;
}

/// Blocks of 4 px use the full resolution, of 8 px half of it, and so on.
Tensor levels_of(const std::vector<Block>& blocks) {
  Tensor levels = torch::empty({static_cast<std::int64_t>(blocks.size())}, torch::kInt32);
  auto* p = levels.data_ptr<std::int32_t>();
  for (const Block& b : blocks) {
    int level = 0;
    while (level + 1 < kSweepLevels && (8 << level) <= b.size) ++level;
    *p++ = level;
  }
  return levels;
}

GrayMedium gray_medium(const std::optional<medium::Medium>& medium) {
  if (!medium) return {};
  const auto gray = [](const Tensor& rgb) {
    const Tensor c = rgb.detach().to(torch::kCPU, torch::kFloat64);
    return 0.299 * c[0].item<double>() + 0.587 * c[1].item<double>() + 0.114 * c[2].item<double>();
  };
  return {
      .beta_d = gray(medium->beta_d), .beta_b = gray(medium->beta_b), .b_inf = gray(medium->b_inf)};
}

/// Indices [N] int64 of the row minima of [N,L].
Tensor min_index(const Tensor& values) {
  return std::get<1>(values.min(1));
}

Tensor pick(const Tensor& values, const Tensor& index) {
  return values.gather(1, index.unsqueeze(1)).squeeze(1);
}

class Estimator {
 public:
  Estimator(std::vector<DepthView> views, const SweepGeometry& geometry,
            const DepthRequest& request, const DepthOptions& options)
      : views_(std::move(views)),
        device_(views_.front().gray.device()),
        options_(options),
        backend_(depth_backend(device_)),
        geometry_(on_device(geometry, device_)),
        medium_(options.compensate_medium ? gray_medium(request.medium) : GrayMedium{}) {
    std::vector<Tensor> grays;
    for (const DepthView& view : views_) grays.push_back(view.gray);
    images_ = backend_.prepare(grays);
  }

  void estimate(DepthEstimate& out) {
    std::tie(out.near_m, out.far_m) = range();
    out.views = static_cast<int>(views_.size()) - 1;
    points_ = out.points.to(device_);
    levels_ = levels_of(out.blocks).to(device_);
    const Tensor w = hypotheses(out.near_m, out.far_m, options_).to(device_);
    const SweepOutput swept = sweep(points_, levels_, w, {});
    const Graph graph = graph_of(out.blocks);
    const Tensor belief = beliefs(swept.cost, graph, out.blocks);
    const Choice choice = choose(w, belief, swept, graph);
    out.dense = upsampled(choice, out.blocks).to(torch::kCPU);
    const Tensor all =
        torch::stack({choice.depth, choice.sigma, choice.confidence}).to(torch::kCPU);
    out.depth = all[0];
    out.sigma = all[1];
    out.confidence = all[2];
    out.slope = choice.slope.to(torch::kCPU);
    out.confident = out.confidence >= options_.confidence.min_confidence;
  }

 private:
  /// Selected depth of each block, on the device.
  struct Choice {
    Tensor depth, sigma, confidence, slope;
  };

  int width() const { return views_.front().camera.intrinsics.width; }
  int height() const { return views_.front().camera.intrinsics.height; }

  SweepOutput sweep(const Tensor& points, const Tensor& levels, const Tensor& w,
                    const Tensor& slopes) const {
    return backend_.sweep(
        images_, {.projections = geometry_.projections,
                  .points = points,
                  .levels = levels,
                  .inverse_depths = w.contiguous(),
                  .slopes = slopes.defined() ? slopes.contiguous() : torch::zeros_like(points),
                  .rays = geometry_.rays,
                  .centers = geometry_.centers,
                  .cost = options_.cost,
                  .best_share = options_.best_views_fraction,
                  .noise = options_.intensity_sigma,
                  .patch_sigma = options_.patch_intensity_sigma,
                  .medium = medium_});
  }

  /// Depth range of the search, from a coarse sweep of the largest blocks.
  std::pair<double, double> range() const {
    const std::pair<double, double> all = {options_.min_depth_m, options_.max_depth_m};
    if (!options_.adapt_range) return all;
    const Tensor points = points_of(grid_of(width(), height(), options_.quadtree.max_block_px),
                                    BlockRepresentative::center)
                              .to(device_);
    const Tensor levels =
        torch::full({points.size(0)}, kRangeLevel, torch::dtype(torch::kInt32).device(device_));
    const Tensor w = hypotheses(all.first, all.second, options_).to(device_);
    const SweepOutput swept = sweep(points, levels, w, {});
    const Tensor label = min_index(swept.cost);
    const Tensor sure = (pick(swept.cost, label) < options_.confidence.half_confidence_cost) &
                        (margin(swept.cost, label, torch::full_like(label, kMinimumHalfWidth)) >
                         options_.confidence.uniqueness_margin);
    const Tensor found = std::get<0>(w.expand_as(swept.cost)
                                         .gather(1, label.unsqueeze(1))
                                         .squeeze(1)
                                         .masked_select(sure)
                                         .to(torch::kCPU)
                                         .sort());
    const std::int64_t n = found.numel();
    if (static_cast<std::size_t>(n) < kMinBlocksForRange) return all;
    const auto tail = static_cast<std::int64_t>(kRangeTail * static_cast<double>(n));
    const double farthest = found[tail].item<double>() / kRangeFarFactor;
    const double nearest = found[n - 1 - tail].item<double>() * kRangeNearFactor;
    return {std::max(all.first, 1.0 / nearest), std::min(all.second, 1.0 / farthest)};
  }

  /// Difference of the minimum cost [B,L] more than `reach` [B] hypotheses away from `label` and
  /// the cost at `label`.
  static Tensor margin(const Tensor& cost, const Tensor& label, const Tensor& reach) {
    const Tensor all = torch::arange(cost.size(1), reach.options());
    const Tensor here = (all.unsqueeze(0) - label.unsqueeze(1)).abs() <= reach.unsqueeze(1);
    return std::get<0>(cost.masked_fill(here, kExcludedCost).min(1)) - pick(cost, label);
  }

  /// Block graph on the device; [E] or [B+1] int32, as in BlockGraph.
  struct Graph {
    Tensor offsets, neighbors, reverse;
    Tensor from;  ///< [E] source node
  };

  /// Uploads everything in one transfer, as each transfer waits for the sweep.
  Graph graph_of(const std::vector<Block>& blocks) const {
    const BlockGraph graph = neighbor_graph(blocks, width(), height());
    std::vector<std::int32_t> from(graph.neighbors.size());
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      std::fill(from.begin() + graph.offsets[i], from.begin() + graph.offsets[i + 1],
                static_cast<std::int32_t>(i));
    }
    std::vector<std::int64_t> sizes;
    const std::array<const std::vector<std::int32_t>*, 4> lists = {&graph.offsets, &graph.neighbors,
                                                                   &graph.reverse, &from};
    for (const auto* const list : lists) {
      sizes.push_back(static_cast<std::int64_t>(list->size()));
    }
    const Tensor all = torch::empty({std::reduce(sizes.begin(), sizes.end())},
                                    torch::dtype(torch::kInt32).pinned_memory(device_.is_cuda()));
    auto* to = all.data_ptr<std::int32_t>();
    for (const auto* const list : lists) {
      to = std::copy(list->begin(), list->end(), to);
    }
    const std::vector<Tensor> parts =
        all.to(device_, /*non_blocking=*/true).split_with_sizes(sizes);
    return {parts[0], parts[1], parts[2], parts[3]};
  }

  /// Beliefs [B,L] of each block after belief propagation.
  Tensor beliefs(const Tensor& cost, const Graph& graph, const std::vector<Block>& blocks) const {
    if (!options_.belief_propagation.enabled) return cost;
    return backend_.propagate({.cost = cost,
                               .offsets = graph.offsets,
                               .neighbors = graph.neighbors,
                               .reverse = graph.reverse,
                               .weights = edge_weights(graph, blocks),
                               .step = options_.belief_propagation.cost_per_step,
                               .limit = options_.belief_propagation.max_cost,
                               .iterations = options_.belief_propagation.iterations});
  }

  /// Neighbors of different intensity are less likely to have the same depth.
  Tensor edge_weights(const Graph& graph, const std::vector<Block>& blocks) const {
    Tensor mean = torch::empty({static_cast<std::int64_t>(blocks.size())}, torch::kFloat32);
    auto* to = mean.data_ptr<float>();
    for (const Block& b : blocks) *to++ = b.mean;
    mean = mean.to(device_);
    const Tensor difference =
        (mean.index_select(0, graph.from) - mean.index_select(0, graph.neighbors)).abs();
    return (difference * (-1.0 / options_.belief_propagation.edge_sigma)).exp();
  }

  /// Refined depth, slope and confidence of each block.
  Choice choose(const Tensor& w, const Tensor& belief, const SweepOutput& swept,
                const Graph& graph) const {
    const Tensor row = w.squeeze(0);
    const Tensor label = min_index(belief);
    const std::int64_t last = row.numel() - 1;
    const Tensor step = 0.5 * (row.index_select(0, (label - 1).clamp_min(0)) -
                               row.index_select(0, (label + 1).clamp_max(last)));
    Tensor best = row.index_select(0, label);
    const FittedPlanes surfaces =
        backend_.fit_planes({.inverse_depths = best,
                             .points = points_,
                             .offsets = graph.offsets,
                             .neighbors = graph.neighbors,
                             .max_relative_difference = kMaxSurfaceDifference,
                             .max_slope = kMaxSlope});
    BlockEvidence evidence = {.cost = pick(swept.cost, label),
                              .margin = margin(belief, label, reach(best, step)),
                              .relative_sigma = {},
                              .seen = pick(swept.views, label).to(torch::kFloat32),
                              .agreement = surfaces.agreement};
    double fineness = 1.0;
    for (int round = 0; round < kRefinements; ++round) {
      fineness /= kRefinementSteps;
      std::tie(best, evidence.cost) = refined(best, fineness * step, surfaces.slope);
    }
    const Tensor pixels = pixels_per_inverse_depth(geometry_, points_, best);
    evidence.relative_sigma = options_.confidence.match_sigma_px / (pixels * best).clamp_min(1e-9);
    const Tensor depth = best.reciprocal();
    return {.depth = depth,
            .sigma = (depth * evidence.relative_sigma).clamp_max(options_.max_depth_m),
            .confidence = confidence_of(evidence, options_.confidence),
            .slope = surfaces.slope};
  }

  /// Minimum cost around `w` in finer steps, with parabolic interpolation.
  std::pair<Tensor, Tensor> refined(const Tensor& w, const Tensor& step,
                                    const Tensor& slope) const {
    const Tensor offsets = torch::arange(kRefinementSteps, -kRefinementSteps - 1, -1, w.options());
    const Tensor tried = (w.unsqueeze(1) + step.unsqueeze(1) * offsets)
                             .clamp(1.0 / options_.max_depth_m, 1.0 / options_.min_depth_m);
    const SweepOutput swept = sweep(points_, levels_, tried, slope);
    const Tensor label = min_index(swept.cost);
    const Tensor inner = label.clamp(1, 2 * kRefinementSteps - 1);
    const Tensor left = pick(swept.cost, inner - 1);
    const Tensor middle = pick(swept.cost, inner);
    const Tensor right = pick(swept.cost, inner + 1);
    const Tensor curvature = left - 2.0 * middle + right;
    const Tensor shift =
        torch::where((curvature > 1e-6) & (inner == label), 0.5 * (left - right) / curvature,
                     torch::zeros_like(curvature))
            .clamp(-0.5, 0.5);
    return {pick(tried, label) - step * shift, pick(swept.cost, label)};
  }

  /// Half-width of the cost minimum in hypotheses.
  Tensor reach(const Tensor& w, const Tensor& step) const {
    const Tensor pixels = pixels_per_inverse_depth(geometry_, points_, w) * step;
    return (kMinimumHalfWidth_px / pixels.clamp_min(1e-6))
        .clamp(kMinimumHalfWidth, 0.25 * options_.hypotheses);
  }

  /// Upsamples 1/depth from the blocks' representatives to the image [H,W].
  Tensor upsampled(const Choice& choice, const std::vector<Block>& blocks) const {
    Tensor known_at = torch::empty({2, static_cast<std::int64_t>(blocks.size())}, torch::kInt32);
    auto* pixel = known_at.data_ptr<std::int32_t>();
    auto* area = pixel + blocks.size();
    for (const Block& block : blocks) {
      const Block b = represented(block, options_.quadtree.representative);
      *pixel++ = (b.y + b.height / 2) * width() + b.x + b.width / 2;
      *area++ = block.width * block.height;
    }
    known_at = known_at.to(device_);
    const Tensor at = known_at[0].to(torch::kInt64);
    const Tensor weights = (choice.confidence + 1e-3) * known_at[1];
    const Tensor empty =
        torch::zeros({2, std::int64_t{height()} * width()}, choice.depth.options());
    const Tensor sparse =
        empty.index_copy(1, at, torch::stack({choice.depth.reciprocal(), weights}))
            .view({2, height(), width()});
    const Tensor smooth = backend_.smooth({.guide = views_.front().gray,
                                           .values = sparse[0],
                                           .weights = sparse[1],
                                           .options = options_.upsample});
    const Tensor known = (smooth[1] > 0) & (smooth[0] > 0);
    return torch::where(known, smooth[0].clamp_min(1e-6).reciprocal(),
                        torch::zeros_like(smooth[0]));
  }

  std::vector<DepthView> views_;
  torch::Device device_;
  DepthOptions options_;
  const DepthBackend& backend_;
  SweepGeometry geometry_;
  GrayMedium medium_;
  SweepImages images_;
  Tensor points_;  ///< the blocks' representatives, on the device
  Tensor levels_;
};

void check_options(const DepthOptions& o) {
  TORCH_CHECK(o.min_depth_m > 0.0 && o.min_depth_m < o.max_depth_m && std::isfinite(o.max_depth_m),
              "depth: expected 0 < min_depth_m < max_depth_m, got ", o.min_depth_m, " to ",
              o.max_depth_m, " m");
  TORCH_CHECK(o.hypotheses >= 8, "depth: hypotheses must be at least 8, not ", o.hypotheses);
  TORCH_CHECK(o.views >= 1, "depth: views must be at least 1");
  TORCH_CHECK(o.patch_intensity_sigma > 0.0, "depth: patch_intensity_sigma must be positive, not ",
              o.patch_intensity_sigma);
  TORCH_CHECK(o.best_views_fraction > 0.0 && o.best_views_fraction <= 1.0,
              "depth: best_views_fraction must be in (0, 1], not ", o.best_views_fraction);
}

DepthStatus initial_status(const SweepGeometry& geometry, const Tensor& gray) {
  if (geometry.projections.size(0) == 0) return DepthStatus::too_few_views;
  if (gray.std().item<double>() < kMinContrast) return DepthStatus::no_contrast;
  if (geometry.baseline_m < kMinBaseline_m) return DepthStatus::no_baseline;
  return DepthStatus::estimated;
}

/// Marks every block as unknown.
void fill_unknown(DepthEstimate& out, const Tensor& gray) {
  const Tensor none = torch::zeros({out.points.size(0)}, torch::kFloat32);
  out.depth = none.clone();
  out.sigma = none.clone();
  out.confidence = none.clone();
  out.confident = none > 0.5;
  out.slope = torch::zeros_like(out.points);
  out.dense = torch::zeros_like(gray);
}

}  // namespace

DepthEstimate estimate_depth(const DepthRequest& request, const DepthOptions& options) {
  const torch::NoGradGuard no_grad;
  check_options(options);
  check_views(request.views);
  const auto used = std::min(request.views.size(), static_cast<std::size_t>(options.views));
  std::vector<DepthView> views(request.views.begin(),
                               request.views.begin() + static_cast<std::ptrdiff_t>(used));
  const Tensor gray = views.front().gray.to(torch::kCPU);
  const SweepGeometry geometry = sweep_geometry(views);
  DepthEstimate out;
  out.status = initial_status(geometry, gray);
  out.near_m = options.min_depth_m;
  out.far_m = options.max_depth_m;
  out.blocks = build_quadtree(gray, options.quadtree);
  out.points = points_of(out.blocks, options.quadtree.representative);
  if (out.status == DepthStatus::estimated) {
    Estimator(std::move(views), geometry, request, options).estimate(out);
  } else {
    fill_unknown(out, gray);
  }
  return out;
}

Tensor to_gray(const Tensor& image) {
  TORCH_CHECK(image.dim() == 3 && image.size(2) == 3, "to_gray: the image must be [H,W,3], not ",
              image.sizes());
  const double unit = image.scalar_type() == torch::kUInt8 ? 1.0 / 255.0 : 1.0;
  const Tensor weights =
      (torch::tensor({0.299, 0.587, 0.114}).to(torch::kFloat32) * unit).to(image.device());
  return image.to(torch::kFloat32).matmul(weights).clamp(0.0, 1.0).contiguous();
}

}  // namespace apvi::depth
