// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/alignment/image_alignment.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <vector>

#include "mapping/appearance/view_corrections.hpp"
#include "mapping/density/seeds.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kMinWidth_px = 40;        // of the coarsest level
constexpr std::int64_t kLocalMeanWindow_px = 9;  // window of the local mean
constexpr double kSurfaceAlpha = 0.9;            // minimum alpha of a surface pixel
constexpr double kMaxDepthSpread = 0.05;         // relative, among neighboring pixels
constexpr double kMinPixelWeight = 0.3;          // of a pixel of a reduced level
constexpr double kMinOverlap = 0.15;             // compared fraction of the image
constexpr int kMaxIterations = 12;               // per level
constexpr double kMinUpdate_px = 0.01;           // convergence threshold
constexpr double kHuber = 1.345;                 // sigmas
constexpr double kMinSigma = 2e-3;               // half a gray level
constexpr double kCorrelatedPixels = 25.0;  // effective number of pixels with correlated errors
constexpr double kMinGain = 0.5;
constexpr double kMaxGain = 2.0;
constexpr double kMinCorrelation = 0.5;      // less: silt or a different place
constexpr double kMaxSigmas = 4.0;           // deviation from the prior
constexpr double kMaxResidualRatio = 0.998;  // of the initial residual
// After a large shift the initial images hardly correlate, so the residual must drop further. In
// simulated dives, correct alignments left 0.67 to 0.91 of the residual and a wrong one 0.99.
constexpr double kLargeShift_px = 2.0;
constexpr double kMaxResidualRatioFar = 0.95;

/// Pyramid level: gray images and per-pixel data, [1,1,h,w].
struct Level {
  Tensor rendered;
  Tensor observed;
  Tensor depth;
  Tensor weight;  ///< fraction of the pixel on a surface
  double scale = 1.0;
};

/// The compared pixels of a level.
struct Pixels {
  Tensor points;    ///< [n,3] in the frame of the prior camera
  Tensor rendered;  ///< [n] minus the local mean
  Tensor jacobian;  ///< [n,6] derivatives of `rendered` by point motion: translation, rotation
  Tensor weight;    ///< [n] weights, 0 to 1
  Tensor observed;  ///< [1,1,h,w] image minus its local mean
  Tensor normalized_camera;  ///< [2,2] focal lengths and principal point in normalized coordinates
  double focal_px = 0.0;
  double overlap = 0.0;
};

Tensor gray(const Tensor& image) {
  return image.mean(2).unsqueeze(0).unsqueeze(0);
}

Tensor subtract_local_mean(const Tensor& image) {
  return image - torch::avg_pool2d(image, kLocalMeanWindow_px, 1, kLocalMeanWindow_px / 2,
                                   /*ceil_mode=*/false,
                                   /*count_include_pad=*/false);
}

// Excludes depth discontinuities.
Tensor is_smooth(const Tensor& depth) {
  const Tensor farthest = torch::max_pool2d(depth, 3, 1, 1);
  const Tensor nearest = -torch::max_pool2d(-depth, 3, 1, 1);
  return (farthest - nearest < kMaxDepthSpread * depth).to(depth.options());
}

std::vector<Level> pyramid(const MapRendering& rendering, const Tensor& image) {
  Level level;
  level.rendered = gray(rendering.color);
  level.observed = gray(image);
  level.depth = rendering.depth.unsqueeze(0).unsqueeze(0);
  level.weight = is_smooth(level.depth) * (rendering.alpha > kSurfaceAlpha);
  std::vector<Level> levels = {level};
  while (level.rendered.size(3) >= 2 * kMinWidth_px) {
    const Tensor weight = torch::avg_pool2d(level.weight, 2);
    level = {.rendered = torch::avg_pool2d(level.rendered, 2),
             .observed = torch::avg_pool2d(level.observed, 2),
             .depth = torch::avg_pool2d(level.weight * level.depth, 2) / weight.clamp_min(1e-6),
             .weight = weight,
             .scale = 0.5 * level.scale};
    levels.push_back(level);
  }
  return levels;
}

/// Central differences of [1,1,h,w] along an axis.
Tensor central_difference(const Tensor& image, std::int64_t axis) {
  return 0.5 * (image.roll(-1, axis) - image.roll(1, axis));
}

Pixels select_pixels(const Level& level, const gaussians::Intrinsics& camera) {
  const auto options = level.rendered.options();
  const std::int64_t h = level.rendered.size(2);
  const std::int64_t w = level.rendered.size(3);
  const double fx = level.scale * camera.fx;
  const double fy = level.scale * camera.fy;
  const double cx = level.scale * camera.cx;
  const double cy = level.scale * camera.cy;
  const Tensor rendered = subtract_local_mean(level.rendered);
  Tensor inside = torch::zeros_like(level.weight);  // pixels with all neighbors in the image
  inside.slice(2, 1, h - 1).slice(3, 1, w - 1).fill_(1.0);
  const Tensor which = (level.weight * inside > kMinPixelWeight).flatten().nonzero().squeeze(1);
  const auto pick = [&which](const Tensor& image) {
    return image.flatten().index_select(0, which);
  };
  const Tensor z = pick(level.depth);
  const Tensor a = ((which % w).to(options) + 0.5 - cx) / fx;  // the ray, at unit depth
  const Tensor b = (torch::floor_divide(which, w).to(options) + 0.5 - cy) / fy;
  const Tensor gu = fx * pick(central_difference(rendered, 3));
  const Tensor gv = fy * pick(central_difference(rendered, 2));
  const Tensor along = a * gu + b * gv;
  const Tensor jacobian = torch::stack(
      {gu / z, gv / z, -along / z, -gv - b * along, gu + a * along, a * gv - b * gu}, 1);
  const double half_w = 0.5 * static_cast<double>(w);
  const double half_h = 0.5 * static_cast<double>(h);
  return {
      .points = torch::stack({a * z, b * z, z}, 1),
      .rendered = pick(rendered),
      .jacobian = jacobian,
      .weight = pick(level.weight),
      .observed = subtract_local_mean(level.observed),
      .normalized_camera =
          torch::tensor({fx / half_w, fy / half_h, cx / half_w - 1.0, cy / half_h - 1.0}, options)
              .view({2, 2}),
      .focal_px = fx,
      .overlap = static_cast<double>(which.size(0)) / static_cast<double>(h * w)};
}

/// Projects camera-frame points [n,3] to normalized image coordinates [n,2] in -1 to 1.
Tensor project_normalized(const Pixels& pixels, const Tensor& points) {
  const Tensor z = points.select(1, 2).clamp_min(1e-3).unsqueeze(1);
  return points.slice(1, 0, 2) / z * pixels.normalized_camera[0] + pixels.normalized_camera[1];
}

/// Median displacement of the pixels' points by the motion `T` [px].
double shift_px(const Pixels& pixels, const Tensor& T) {
  const Tensor points = transform_points(T.to(pixels.points.options()), pixels.points);
  const Tensor shift =
      project_normalized(pixels, points) - project_normalized(pixels, pixels.points);
  const Tensor half =
      torch::tensor({pixels.observed.size(3), pixels.observed.size(2)}, shift.options()) / 2.0;
  return (shift * half).norm(2, 1).median().item<double>();
}

/// The image sampled at the pixels' points projected from a camera at `T`.
struct SampledImage {
  Tensor observed;
  Tensor visible;  ///< weights; 0 outside the image
};

SampledImage sample(const Pixels& pixels, const Tensor& T) {
  const Tensor points = transform_points(T.to(pixels.points.options()), pixels.points);
  const Tensor at = project_normalized(pixels, points);
  constexpr std::int64_t kLinear = 0;
  constexpr std::int64_t kBorder = 1;
  const Tensor observed =
      torch::grid_sampler(pixels.observed, at.view({1, 1, -1, 2}), kLinear, kBorder,
                          /*align_corners=*/false)
          .flatten();
  const Tensor visible = (at.abs() < 1.0).all(1) & (points.select(1, 2) > 1e-3);
  return {observed, pixels.weight * visible};
}

/// Residuals and robust weights after gain correction.
struct Comparison {
  Tensor residuals;
  Tensor weights;
  double sigma = 0.0;
  double mean = 0.0;  ///< robust mean absolute residual of the visible pixels
  double correlation = 0.0;
};

Comparison compare(const Pixels& pixels, const Tensor& T) {
  const SampledImage sampled = sample(pixels, T);
  const Tensor products =
      torch::stack({(sampled.visible * pixels.rendered * sampled.observed).sum(),
                    (sampled.visible * sampled.observed.square()).sum(),
                    (sampled.visible * pixels.rendered.square()).sum()})
          .to(torch::kCPU, torch::kFloat64);
  const auto sums = products.accessor<double, 1>();
  const double gain = std::clamp(sums[0] / std::max(1e-12, sums[1]), kMinGain, kMaxGain);
  Comparison result;
  result.correlation = sums[0] / std::sqrt(std::max(1e-12, sums[1] * sums[2]));
  result.residuals = pixels.rendered - gain * sampled.observed;
  const Tensor size = result.residuals.abs();
  result.sigma = std::max(kMinSigma, 1.4826 * size.median().item<double>());
  result.weights = sampled.visible * (kHuber * result.sigma / size.clamp_min(1e-9)).clamp_max(1.0);
  result.mean =
      ((result.weights * size).sum() / sampled.visible.sum().clamp_min(1.0)).item<double>();
  return result;
}

/// Current motion estimate and its deviation from the prior.
struct Estimate {
  Tensor T = torch::eye(4, torch::kFloat64);
  Tensor twist = torch::zeros({6}, torch::kFloat64);
};

void optimize_pose(const Pixels& pixels, const Tensor& prior, double depth, Estimate& estimate) {
  for (int k = 0; k < kMaxIterations; ++k) {
    const Comparison now = compare(pixels, estimate.T);
    const Tensor weighted = pixels.jacobian * now.weights.unsqueeze(1);
    const Tensor sums =
        torch::cat({weighted.t().mm(pixels.jacobian), weighted.t().mm(now.residuals.unsqueeze(1))},
                   1)
            .to(torch::kCPU, torch::kFloat64) /
        (kCorrelatedPixels * now.sigma * now.sigma);
    const Tensor information = sums.slice(1, 0, 6) + prior.diag();
    const Tensor gradient = prior * estimate.twist - sums.select(1, 6);
    const Tensor step = torch::mv(torch::inverse(information), gradient);
    estimate.T = estimate.T.mm(corrected_pose(torch::eye(4, torch::kFloat64), -step));
    estimate.twist = estimate.twist - step;
    const double change =
        step.slice(0, 0, 3).norm().item<double>() / depth + step.slice(0, 3).norm().item<double>();
    if (!(change * pixels.focal_px > kMinUpdate_px)) return;
  }
}

}  // namespace

std::optional<ImageAlignment> align_image(const MapRendering& rendering, const Tensor& image,
                                          const gaussians::Intrinsics& intrinsics,
                                          const PoseSigmas& sigmas) {
  const torch::NoGradGuard no_grad;
  const double t = 1.0 / (sigmas.translation_m * sigmas.translation_m);
  const double r = 1.0 / (sigmas.rotation_rad * sigmas.rotation_rad);
  const Tensor prior = torch::tensor({t, t, t, r, r, r}, torch::kFloat64);
  const std::vector<Level> levels = pyramid(rendering, image);
  Estimate estimate;
  ImageAlignment result;
  double max_ratio = kMaxResidualRatio;
  for (auto level = levels.rbegin(); level != levels.rend(); ++level) {
    const Pixels pixels = select_pixels(*level, intrinsics);
    if (pixels.overlap < kMinOverlap) return std::nullopt;
    const double depth = pixels.points.select(1, 2).median().item<double>();
    optimize_pose(pixels, prior, depth, estimate);
    const Comparison now = compare(pixels, estimate.T);
    // Noise lowers the correlation at fine levels.
    result.correlation = std::max(result.correlation, now.correlation);
    if (std::next(level) != levels.rend()) continue;
    result.T_camera_prior = estimate.T;
    result.residual_before = compare(pixels, torch::eye(4, torch::kFloat64)).mean;
    result.residual_after = now.mean;
    result.overlap = pixels.overlap;
    if (shift_px(pixels, estimate.T) > kLargeShift_px) max_ratio = kMaxResidualRatioFar;
  }
  const double sigmas_off = (prior * estimate.twist.square()).sum().sqrt().item<double>();
  const bool fits = sigmas_off < kMaxSigmas && result.correlation > kMinCorrelation &&
                    result.residual_after < max_ratio * result.residual_before;
  return fits ? std::optional(result) : std::nullopt;
}

}  // namespace apvi::mapping
