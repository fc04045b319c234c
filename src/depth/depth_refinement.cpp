// SPDX-License-Identifier: BSD-3-Clause
#include "depth/depth_refinement.hpp"

#include <torch/torch.h>

#include <cmath>
#include <cstdint>

#include "depth/depth_backend.hpp"
#include "depth/depth_confidence.hpp"
#include "depth/depth_geometry.hpp"

namespace apvi::depth {
namespace {

using torch::Tensor;

/// Steps of a sweep on either side of the depth so far, in pixels of disparity.
struct Round {
  int level;  ///< pyramid level
  double step_px;
  std::int64_t steps;
};
constexpr Round kSearch{.level = 1, .step_px = 1.0, .steps = 6};
constexpr Round kRefine{.level = 0, .step_px = 0.4, .steps = 4};

constexpr double kMinPixelsPerInverseDepth = 1e-6;
constexpr std::int64_t kMinimumHalfWidth = 2;  // of a cost minimum, in steps of the search
constexpr std::int64_t kSlopeWindow = 5;       // [px] of the depth image
constexpr double kMaxSlope = 0.02;             // relative change of 1/depth of a surface [1/px]
// Smoothness of the given depth and of changes; squares of lengths [px].
constexpr double kGivenSmoothness = 16.0;
constexpr double kSmoothness = 4.0;
constexpr double kSurfaceStep = 0.02;  // relative change of depth that ends a surface
constexpr double kMinWeight = 1e-9;    // of a smoothed value
constexpr float kExcludedCost = 1e9F;

Tensor pick(const Tensor& values, const Tensor& index) {
  return values.gather(1, index.unsqueeze(1)).squeeze(1);
}

Tensor box_mean(const Tensor& image) {
  return torch::avg_pool2d(image.unsqueeze(0).unsqueeze(0), kSlopeWindow, 1, kSlopeWindow / 2)
      .squeeze(0)
      .squeeze(0);
}

/// The values [h,w] at the pixels where `known` is true, their neighborhood elsewhere.
Tensor blurred(const Tensor& values, const Tensor& known) {
  const Tensor weight = box_mean(known.to(torch::kFloat32));
  return box_mean(torch::where(known, values, torch::zeros_like(values))) / weight.clamp_min(1e-6);
}

/// Central differences along x and y of [h,w]; 0 at the border.
Tensor change_per_pixel(const Tensor& image) {
  Tensor out = torch::zeros({image.size(0), image.size(1), 2}, image.options());
  out.select(2, 0).slice(1, 1, -1).copy_(0.5 * (image.slice(1, 2) - image.slice(1, 0, -2)));
  out.select(2, 1).slice(0, 1, -1).copy_(0.5 * (image.slice(0, 2) - image.slice(0, 0, -2)));
  return out;
}

class Refiner {
 public:
  Refiner(const RefinementRequest& request, const DepthOptions& options)
      : options_(options),
        depth_(request.depth),
        known_(request.depth > 0.0),
        device_(request.depth.device()),
        backend_(depth_backend(device_)),
        geometry_(on_device(sweep_geometry(request.views), device_)) {
    std::vector<Tensor> grays;
    for (const DepthView& view : request.views) grays.push_back(view.gray);
    images_ = backend_.prepare(grays);
    const gaussians::Intrinsics& k = request.views.front().camera.intrinsics;
    scale_x_ = static_cast<double>(k.width) / static_cast<double>(depth_.size(1));
    scale_y_ = static_cast<double>(k.height) / static_cast<double>(depth_.size(0));
    const Tensor at = known_.nonzero().to(torch::kFloat32) + 0.5;
    points_ = torch::stack({at.select(1, 1) * scale_x_, at.select(1, 0) * scale_y_}, 1);
  }

  RefinedDepth refine() const {
    const Tensor given = depth_.index({known_}).reciprocal();
    // What is left of the noise of the given depth cannot be told from the surface later on.
    const Tensor even = smoothed(given, torch::ones_like(given), kGivenSmoothness).values;
    const Match found = search(even, kSearch);
    const Tensor coarse =
        even * smoothed(found.w / even, confidence(found, found), kSmoothness).values;
    const Match refined = search(coarse, kRefine);
    const Smoothed change = smoothed(refined.w / coarse, confidence(refined, found), kSmoothness);
    return {.ratio = image_of(given / (coarse * change.values), 1.0F),
            .confidence = image_of(change.weights, 0.0F)};
  }

 private:
  /// The best hypothesis of each point.
  struct Match {
    Tensor w;       ///< 1/depth
    Tensor cost;    ///< there
    Tensor margin;  ///< by which other minima cost more
    Tensor seen;    ///< number of images that observe it
    Tensor inner;   ///< bool: not at the end of the range
  };

  /// Of each point.
  struct Smoothed {
    Tensor values;   ///< 1 without any weight nearby
    Tensor weights;  ///< smoothed, too
  };

  Tensor image_of(const Tensor& values, float elsewhere) const {
    Tensor out = torch::full_like(depth_, elsewhere);
    out.index_put_({known_}, values);
    return out;
  }

  /// Relative change of 1/depth per pixel of the reference image [B,2].
  Tensor slopes(const Tensor& w) const {
    const Tensor image = blurred(image_of(w, 0.0F), known_);
    const Tensor change = change_per_pixel(image).index({known_}) / w.unsqueeze(1);
    const Tensor scale = torch::tensor({1.0 / scale_x_, 1.0 / scale_y_}, w.options());
    return (change * scale).clamp(-kMaxSlope, kMaxSlope).contiguous();
  }

  Match search(const Tensor& w, const Round& round) const {
    const Tensor step =
        round.step_px /
        pixels_per_inverse_depth(geometry_, points_, w).clamp_min(kMinPixelsPerInverseDepth);
    const Tensor offsets = torch::arange(-round.steps, round.steps + 1, w.options());
    // No hypothesis is behind the camera.
    const Tensor tried =
        torch::maximum(w.unsqueeze(1) + step.unsqueeze(1) * offsets, 0.2 * w.unsqueeze(1));
    const SweepOutput swept =
        backend_.sweep(images_, {.projections = geometry_.projections,
                                 .points = points_,
                                 .levels = torch::full({w.size(0)}, round.level,
                                                       torch::dtype(torch::kInt32).device(device_)),
                                 .inverse_depths = tried.contiguous(),
                                 .slopes = slopes(w),
                                 .rays = geometry_.rays,
                                 .centers = geometry_.centers,
                                 .cost = PhotometricCost::zncc,
                                 .best_share = options_.best_views_fraction,
                                 .noise = options_.intensity_sigma,
                                 .patch_sigma = options_.patch_intensity_sigma,
                                 .medium = {}});
    return best_of(tried, step, swept);
  }

  static Match best_of(const Tensor& tried, const Tensor& step, const SweepOutput& swept) {
    const std::int64_t last = tried.size(1) - 1;
    const auto [cost, label] = swept.cost.min(1);
    const Tensor middle = label.clamp(1, last - 1);
    const Tensor left = pick(swept.cost, middle - 1);
    const Tensor right = pick(swept.cost, middle + 1);
    const Tensor curvature = left - 2.0 * pick(swept.cost, middle) + right;
    const Tensor inner = (label == middle) & (curvature > 1e-6);
    const Tensor shift = torch::where(inner, 0.5 * (left - right) / curvature.clamp_min(1e-6),
                                      torch::zeros_like(curvature));
    const Tensor all = torch::arange(last + 1, label.options());
    const Tensor here = (all - label.unsqueeze(1)).abs() <= kMinimumHalfWidth;
    return {.w = pick(tried, label) + step * shift.clamp(-0.5, 0.5),
            .cost = cost,
            .margin = std::get<0>(swept.cost.masked_fill(here, kExcludedCost).min(1)) - cost,
            .seen = pick(swept.views, label).to(torch::kFloat32),
            .inner = inner};
  }

  /// That of `match`, whose minimum was unique in the search that found it.
  Tensor confidence(const Match& match, const Match& found) const {
    const Tensor value = confidence_of({.cost = match.cost,
                                        .margin = found.margin,
                                        .relative_sigma = relative_sigma(match.w),
                                        .seen = match.seen,
                                        .agreement = torch::ones_like(match.w)},
                                       options_.confidence);
    return value * (found.inner & match.inner).to(torch::kFloat32);
  }

  Tensor relative_sigma(const Tensor& w) const {
    const Tensor pixels = pixels_per_inverse_depth(geometry_, points_, w);
    return options_.confidence.match_sigma_px / (pixels * w).clamp_min(1e-9);
  }

  /// Within surfaces, as the given depth shows them.
  Smoothed smoothed(const Tensor& values, const Tensor& weights, double smoothness) const {
    const Tensor logs = depth_.clamp_min(1e-6).log();
    const Tensor nearest = torch::where(known_, logs, torch::full_like(logs, 1e3)).min();
    const Tensor farthest = torch::where(known_, logs, torch::full_like(logs, -1e3)).max();
    const double range = std::max(1.0, (farthest - nearest).item<double>());
    const Tensor both = backend_.smooth(
        {.guide = ((logs - nearest) / range).clamp(0.0, 1.0).contiguous(),
         .values = image_of(values, 1.0F),
         .weights = image_of(weights, 0.0F),
         .options = {.lambda = smoothness, .sigma = kSurfaceStep / range, .iterations = 3}});
    const Tensor weight = both[1].index({known_});
    return {.values = torch::where(weight > kMinWeight, both[0].index({known_}),
                                   torch::ones_like(weight)),
            .weights = weight};
  }

  DepthOptions options_;
  Tensor depth_;
  Tensor known_;
  torch::Device device_;
  const DepthBackend& backend_;
  SweepGeometry geometry_;
  SweepImages images_;
  double scale_x_ = 1.0;  ///< pixels of the reference image per pixel of the depth image
  double scale_y_ = 1.0;
  Tensor points_;  ///< [B,2] of the known pixels, in the reference image [px]
};

}  // namespace

RefinedDepth refine_depth(const RefinementRequest& request, const DepthOptions& options) {
  const torch::NoGradGuard no_grad;
  check_views(request.views);
  TORCH_CHECK(request.depth.dim() == 2 && request.depth.scalar_type() == torch::kFloat32,
              "refine_depth: the depth must be [h,w] float32");
  const Tensor known = request.depth > 0.0;
  if (request.views.size() < 2 || !known.any().item<bool>()) {
    return {.ratio = torch::ones_like(request.depth),
            .confidence = torch::zeros_like(request.depth)};
  }
  return Refiner(request, options).refine();
}

}  // namespace apvi::depth
