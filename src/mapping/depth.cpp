// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/depth.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include "apvi/mapping/depth_backend.hpp"
#include "depth_confidence.hpp"
#include "depth_geometry.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kLeastContrast =
    3.0 / 255.0;  // standard deviation of a picture with something in it
constexpr double kLeastBaseline_m = 1e-4;
constexpr int kRangeLevel = 2;         // reduction in which the depths that occur are looked for
constexpr double kRangeTail = 0.01;    // part of the blocks that may lie outside
constexpr double kRangeNearer = 1.25;  // how much nearer than the rest the range begins
constexpr double kRangeFarther = 2.5;  // and how much farther it ends: few blocks see through bars
constexpr std::size_t kFewestForRange = 20;
constexpr int kRefinements = 2;
constexpr std::int64_t kFine = 4;     // finer steps in one step; as many to either side are tried
constexpr double kSteepest = 0.02;    // relative change of 1/depth a pixel that a surface may have
constexpr double kSameSurface = 0.1;  // relative difference of 1/depth between its blocks
constexpr double kNowhere = 1e9;      // cost of what is not to be chosen
constexpr double kSameMinimum_px = 2.0;      // half the width of a minimum in the other pictures
constexpr std::int64_t kSameHypothesis = 3;  // steps within which two minima are one

Tensor centers_of(const std::vector<Block>& blocks) {
  Tensor points = torch::empty({static_cast<std::int64_t>(blocks.size()), 2}, torch::kFloat32);
  auto* p = points.data_ptr<float>();
  for (const Block& b : blocks) {
    *p++ = static_cast<float>(b.x) + 0.5F * static_cast<float>(b.width);
    *p++ = static_cast<float>(b.y) + 0.5F * static_cast<float>(b.height);
  }
  return points;
}

/// Squares that cover the image, row by row, without what is in them; cut off at its edge.
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

/// A block of 4 px is compared in the whole picture, one of 8 in its half, and so on.
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

GreyMedium grey_medium(const std::optional<splat::Medium>& medium) {
  if (!medium) return {};
  const auto grey = [](const Tensor& rgb) {
    const Tensor c = rgb.detach().to(torch::kCPU, torch::kFloat64);
    return 0.299 * c[0].item<double>() + 0.587 * c[1].item<double>() + 0.114 * c[2].item<double>();
  };
  return {
      .beta_d = grey(medium->beta_d), .beta_b = grey(medium->beta_b), .b_inf = grey(medium->b_inf)};
}

/// Indices [N] int64 of rows' least values [N,L], made numbers of their own.
Tensor least_of(const Tensor& values) {
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
        device_(views_.front().grey.device()),
        options_(options),
        backend_(depth_backend(device_)),
        geometry_(on_device(geometry, device_)),
        medium_(grey_medium(request.medium)) {
    std::vector<Tensor> greys;
    for (const DepthView& view : views_) greys.push_back(view.grey);
    pictures_ = backend_.prepare(greys);
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
    out.confident = out.confidence >= options_.confidence.least;
  }

 private:
  /// What is chosen for each block, on the device.
  struct Choice {
    Tensor depth, sigma, confidence, slope;
  };

  int width() const { return views_.front().camera.intrinsics.width; }
  int height() const { return views_.front().camera.intrinsics.height; }

  SweepOutput sweep(const Tensor& points, const Tensor& levels, const Tensor& w,
                    const Tensor& slopes) const {
    return backend_.sweep(
        pictures_, {.projections = geometry_.projections,
                    .points = points,
                    .levels = levels,
                    .inverse_depths = w.contiguous(),
                    .slopes = slopes.defined() ? slopes.contiguous() : torch::zeros_like(points),
                    .rays = geometry_.rays,
                    .centers = geometry_.centers,
                    .cost = options_.cost,
                    .best_share = options_.best_share,
                    .noise = options_.noise,
                    .patch_sigma = options_.patch_sigma,
                    .medium = medium_});
  }

  /// Between which depths to look: where a sweep of the largest blocks finds some.
  std::pair<double, double> range() const {
    const std::pair<double, double> all = {options_.near_m, options_.far_m};
    if (!options_.adapt_range) return all;
    const Tensor points =
        centers_of(grid_of(width(), height(), options_.quadtree.largest_px)).to(device_);
    const Tensor levels =
        torch::full({points.size(0)}, kRangeLevel, torch::dtype(torch::kInt32).device(device_));
    const Tensor w = hypotheses(all.first, all.second, options_).to(device_);
    const SweepOutput swept = sweep(points, levels, w, {});
    const Tensor label = least_of(swept.cost);
    const Tensor sure = (pick(swept.cost, label) < options_.confidence.good_cost) &
                        (margin(swept.cost, label, torch::full_like(label, kSameHypothesis)) >
                         options_.confidence.uniqueness);
    const Tensor found = std::get<0>(w.expand_as(swept.cost)
                                         .gather(1, label.unsqueeze(1))
                                         .squeeze(1)
                                         .masked_select(sure)
                                         .to(torch::kCPU)
                                         .sort());
    const std::int64_t n = found.numel();
    if (static_cast<std::size_t>(n) < kFewestForRange) return all;
    const auto tail = static_cast<std::int64_t>(kRangeTail * static_cast<double>(n));
    const double farthest = found[tail].item<double>() / kRangeFarther;
    const double nearest = found[n - 1 - tail].item<double>() * kRangeNearer;
    return {std::max(all.first, 1.0 / nearest), std::min(all.second, 1.0 / farthest)};
  }

  /// By how much the least cost elsewhere [B,L] exceeds the one at `label`; elsewhere is farther
  /// than `reach` [B] hypotheses.
  static Tensor margin(const Tensor& cost, const Tensor& label, const Tensor& reach) {
    const Tensor all = torch::arange(cost.size(1), reach.options());
    const Tensor here = (all.unsqueeze(0) - label.unsqueeze(1)).abs() <= reach.unsqueeze(1);
    return std::get<0>(cost.masked_fill(here, kNowhere).min(1)) - pick(cost, label);
  }

  /// Who touches whom, on the device; [E] or [B+1] int32, as in BlockGraph.
  struct Graph {
    Tensor offsets, neighbors, reverse;
    Tensor from;  ///< [E] where each edge begins
  };

  /// Brought there together: each way there waits for the sweep.
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

  /// What each block thinks of every hypothesis [B,L], its neighbours having been heard.
  Tensor beliefs(const Tensor& cost, const Graph& graph, const std::vector<Block>& blocks) const {
    if (!options_.belief.enabled) return cost;
    return backend_.propagate({.cost = cost,
                               .offsets = graph.offsets,
                               .neighbors = graph.neighbors,
                               .reverse = graph.reverse,
                               .weights = edge_weights(graph, blocks),
                               .step = options_.belief.step,
                               .limit = options_.belief.limit,
                               .iterations = options_.belief.iterations});
  }

  /// Neighbours that look different may well lie at different depths.
  Tensor edge_weights(const Graph& graph, const std::vector<Block>& blocks) const {
    Tensor mean = torch::empty({static_cast<std::int64_t>(blocks.size())}, torch::kFloat32);
    auto* to = mean.data_ptr<float>();
    for (const Block& b : blocks) *to++ = b.mean;
    mean = mean.to(device_);
    const Tensor difference =
        (mean.index_select(0, graph.from) - mean.index_select(0, graph.neighbors)).abs();
    return (difference * (-1.0 / options_.belief.edge_sigma)).exp();
  }

  /// Depth between the hypotheses, its slope and how sure it is.
  Choice choose(const Tensor& w, const Tensor& belief, const SweepOutput& swept,
                const Graph& graph) const {
    const Tensor row = w.squeeze(0);
    const Tensor label = least_of(belief);
    const std::int64_t last = row.numel() - 1;
    const Tensor step = 0.5 * (row.index_select(0, (label - 1).clamp_min(0)) -
                               row.index_select(0, (label + 1).clamp_max(last)));
    Tensor best = row.index_select(0, label);
    const Surfaces surfaces = backend_.surfaces({.inverse_depths = best,
                                                 .points = points_,
                                                 .offsets = graph.offsets,
                                                 .neighbors = graph.neighbors,
                                                 .same = kSameSurface,
                                                 .steepest = kSteepest});
    BlockEvidence evidence = {.cost = pick(swept.cost, label),
                              .margin = margin(belief, label, reach(best, step)),
                              .relative_sigma = {},
                              .seen = pick(swept.views, label).to(torch::kFloat32),
                              .agreement = surfaces.agreement};
    double fineness = 1.0;
    for (int round = 0; round < kRefinements; ++round) {
      fineness /= kFine;
      std::tie(best, evidence.cost) = refined(best, fineness * step, surfaces.slope);
    }
    const Tensor pixels = pixels_per_inverse_depth(geometry_, points_, best);
    evidence.relative_sigma = options_.confidence.match_sigma_px / (pixels * best).clamp_min(1e-9);
    const Tensor depth = best.reciprocal();
    return {.depth = depth,
            .sigma = (depth * evidence.relative_sigma).clamp_max(options_.far_m),
            .confidence = confidence_of(evidence, options_.confidence),
            .slope = surfaces.slope};
  }

  /// The least cost around `w`, in steps that are a fraction of those before, and between them by a
  /// parabola.
  std::pair<Tensor, Tensor> refined(const Tensor& w, const Tensor& step,
                                    const Tensor& slope) const {
    const Tensor offsets = torch::arange(kFine, -kFine - 1, -1, w.options());
    const Tensor tried = (w.unsqueeze(1) + step.unsqueeze(1) * offsets)
                             .clamp(1.0 / options_.far_m, 1.0 / options_.near_m);
    const SweepOutput swept = sweep(points_, levels_, tried, slope);
    const Tensor label = least_of(swept.cost);
    const Tensor inner = label.clamp(1, 2 * kFine - 1);
    const Tensor left = pick(swept.cost, inner - 1);
    const Tensor middle = pick(swept.cost, inner);
    const Tensor right = pick(swept.cost, inner + 1);
    const Tensor bend = left - 2.0 * middle + right;
    const Tensor shift = torch::where((bend > 1e-6) & (inner == label), 0.5 * (left - right) / bend,
                                      torch::zeros_like(bend))
                             .clamp(-0.5, 0.5);
    return {pick(tried, label) - step * shift, pick(swept.cost, label)};
  }

  /// Hypotheses to either side that are the same minimum still, because the steps are finer than
  /// it.
  Tensor reach(const Tensor& w, const Tensor& step) const {
    const Tensor pixels = pixels_per_inverse_depth(geometry_, points_, w) * step;
    return (kSameMinimum_px / pixels.clamp_min(1e-6))
        .clamp(kSameHypothesis, 0.25 * options_.hypotheses);
  }

  /// Spreads 1/depth from the blocks' centres over the image [H,W].
  Tensor upsampled(const Choice& choice, const std::vector<Block>& blocks) const {
    Tensor centers = torch::empty({2, static_cast<std::int64_t>(blocks.size())}, torch::kInt32);
    auto* pixel = centers.data_ptr<std::int32_t>();
    auto* area = pixel + blocks.size();
    for (const Block& b : blocks) {
      *pixel++ = (b.y + b.height / 2) * width() + b.x + b.width / 2;
      *area++ = b.width * b.height;
    }
    centers = centers.to(device_);
    const Tensor at = centers[0].to(torch::kInt64);
    const Tensor weights = (choice.confidence + 1e-3) * centers[1];
    const Tensor empty =
        torch::zeros({2, std::int64_t{height()} * width()}, choice.depth.options());
    const Tensor sparse =
        empty.index_copy(1, at, torch::stack({choice.depth.reciprocal(), weights}))
            .view({2, height(), width()});
    const Tensor smooth = backend_.smooth({.guide = views_.front().grey,
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
  GreyMedium medium_;
  SweepPictures pictures_;
  Tensor points_;  ///< of the blocks, on the device
  Tensor levels_;
};

void check_options(const DepthOptions& o) {
  TORCH_CHECK(o.near_m > 0.0 && o.near_m < o.far_m && std::isfinite(o.far_m),
              "depth: the range must be 0 < near < far, not ", o.near_m, " to ", o.far_m, " m");
  TORCH_CHECK(o.hypotheses >= 8, "depth: at least 8 hypotheses are needed, not ", o.hypotheses);
  TORCH_CHECK(o.views >= 1, "depth: at least one view is needed");
  TORCH_CHECK(o.patch_sigma > 0.0, "depth: a patch's sigma must be positive, not ", o.patch_sigma);
  TORCH_CHECK(o.best_share > 0.0 && o.best_share <= 1.0,
              "depth: a share of the views must be in (0, 1], not ", o.best_share);
}

DepthVerdict first_look(const SweepGeometry& geometry, const Tensor& grey) {
  if (geometry.projections.size(0) == 0) return DepthVerdict::too_few_views;
  if (grey.std().item<double>() < kLeastContrast) return DepthVerdict::no_contrast;
  if (geometry.baseline_m < kLeastBaseline_m) return DepthVerdict::no_baseline;
  return DepthVerdict::estimated;
}

/// Says of each block that nothing is known.
void know_nothing(DepthEstimate& out, const Tensor& grey) {
  const Tensor none = torch::zeros({out.points.size(0)}, torch::kFloat32);
  out.depth = none.clone();
  out.sigma = none.clone();
  out.confidence = none.clone();
  out.confident = none > 0.5;
  out.slope = torch::zeros_like(out.points);
  out.dense = torch::zeros_like(grey);
}

}  // namespace

DepthEstimate estimate_depth(const DepthRequest& request, const DepthOptions& options) {
  const torch::NoGradGuard no_grad;
  check_options(options);
  check_views(request.views);
  const auto used = std::min(request.views.size(), static_cast<std::size_t>(options.views));
  std::vector<DepthView> views(request.views.begin(),
                               request.views.begin() + static_cast<std::ptrdiff_t>(used));
  const Tensor grey = views.front().grey.to(torch::kCPU);
  const SweepGeometry geometry = sweep_geometry(views);
  DepthEstimate out;
  out.verdict = first_look(geometry, grey);
  out.near_m = options.near_m;
  out.far_m = options.far_m;
  out.blocks = divide(grey, options.quadtree);
  out.points = centers_of(out.blocks);
  if (out.verdict == DepthVerdict::estimated) {
    Estimator(std::move(views), geometry, request, options).estimate(out);
  } else {
    know_nothing(out, grey);
  }
  return out;
}

Tensor to_grey(const Tensor& image) {
  TORCH_CHECK(image.dim() == 3 && image.size(2) == 3, "to_grey: the picture must be [H,W,3], not ",
              image.sizes());
  const double unit = image.scalar_type() == torch::kUInt8 ? 1.0 / 255.0 : 1.0;
  const Tensor weights =
      (torch::tensor({0.299, 0.587, 0.114}).to(torch::kFloat32) * unit).to(image.device());
  return image.to(torch::kFloat32).matmul(weights).clamp(0.0, 1.0).contiguous();
}

}  // namespace apvi::mapping
