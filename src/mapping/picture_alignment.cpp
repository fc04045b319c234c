// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/picture_alignment.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <vector>

#include "apvi/mapping/seeds.hpp"
#include "apvi/mapping/view_corrections.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kLeastWidth = 40;  // of the coarsest picture [px]
constexpr std::int64_t kSquare = 9;       // over which the local mean is taken [px]
constexpr double kSolid = 0.9;            // alpha of a surface
constexpr double kEven = 0.05;            // of its depth within a pixel's neighbours
constexpr double kLeastGood = 0.3;        // of a reduced pixel
constexpr double kLeastShare = 0.15;      // of the picture
constexpr int kMostSteps = 12;            // on a level
constexpr double kStill_px = 0.01;        // a step that moves the picture less is the last one
constexpr double kHuber = 1.345;          // sigmas
constexpr double kLeastSigma = 2e-3;      // half a grey level
constexpr double kAlike = 25.0;           // pixels that err together, being of one patch
constexpr double kLeastGain = 0.5;
constexpr double kMostGain = 2.0;
constexpr double kLeastLikeness = 0.5;  // correlation; less is silt, or another place
constexpr double kMostSigmas = 4.0;     // from where it is believed to be; else it is a mistake
constexpr double kBetter = 0.998;       // of the residual before, at most
// Pictures so far aside have nothing in common, so that much more must fit where they belong. Of
// simulated dives' corrections the right ones left 0.67 to 0.91 of the residual, a wrong one 0.99.
constexpr double kFar_px = 2.0;
constexpr double kMuchBetter = 0.95;

/// Grey pictures of one size, [1,1,h,w], and what is known of their pixels.
struct Level {
  Tensor drawn;
  Tensor seen;
  Tensor depth;
  Tensor good;  ///< share of a pixel that is a surface
  double scale = 1.0;
};

/// The pixels of a level that are compared.
struct Pixels {
  Tensor points;  ///< [n,3] before the believed camera
  Tensor drawn;   ///< [n] less its local mean
  Tensor slopes;  ///< [n,6] of `drawn` by a motion of the point: translation, rotation
  Tensor good;    ///< [n] how far to trust them, 0 to 1
  Tensor seen;    ///< [1,1,h,w] the picture less its local mean
  Tensor lens;    ///< [2,2] f and c over half of the size of the picture
  double focal_px = 0.0;
  double share = 0.0;
};

Tensor grey(const Tensor& picture) {
  return picture.mean(2).unsqueeze(0).unsqueeze(0);
}

Tensor without_mean(const Tensor& image) {
  return image - torch::avg_pool2d(image, kSquare, 1, kSquare / 2,
                                   /*ceil_mode=*/false,
                                   /*count_include_pad=*/false);
}

// An edge of a surface belongs to neither side.
Tensor is_even(const Tensor& depth) {
  const Tensor most = torch::max_pool2d(depth, 3, 1, 1);
  const Tensor least = -torch::max_pool2d(-depth, 3, 1, 1);
  return (most - least < kEven * depth).to(depth.options());
}

std::vector<Level> pyramid(const Picture& shown, const Tensor& picture) {
  Level level;
  level.drawn = grey(shown.as_seen);
  level.seen = grey(picture);
  level.depth = shown.depth.unsqueeze(0).unsqueeze(0);
  level.good = is_even(level.depth) * (shown.alpha > kSolid);
  std::vector<Level> levels = {level};
  while (level.drawn.size(3) >= 2 * kLeastWidth) {
    const Tensor good = torch::avg_pool2d(level.good, 2);
    level = {.drawn = torch::avg_pool2d(level.drawn, 2),
             .seen = torch::avg_pool2d(level.seen, 2),
             .depth = torch::avg_pool2d(level.good * level.depth, 2) / good.clamp_min(1e-6),
             .good = good,
             .scale = 0.5 * level.scale};
    levels.push_back(level);
  }
  return levels;
}

/// Central differences of [1,1,h,w] along an axis.
Tensor slope(const Tensor& image, std::int64_t axis) {
  return 0.5 * (image.roll(-1, axis) - image.roll(1, axis));
}

Pixels compared(const Level& level, const splat::Intrinsics& camera) {
  const auto options = level.drawn.options();
  const std::int64_t h = level.drawn.size(2);
  const std::int64_t w = level.drawn.size(3);
  const double fx = level.scale * camera.fx;
  const double fy = level.scale * camera.fy;
  const double cx = level.scale * camera.cx;
  const double cy = level.scale * camera.cy;
  const Tensor drawn = without_mean(level.drawn);
  Tensor inside = torch::zeros_like(level.good);  // whose neighbours are in the picture
  inside.slice(2, 1, h - 1).slice(3, 1, w - 1).fill_(1.0);
  const Tensor which = (level.good * inside > kLeastGood).flatten().nonzero().squeeze(1);
  const auto pick = [&which](const Tensor& image) {
    return image.flatten().index_select(0, which);
  };
  const Tensor z = pick(level.depth);
  const Tensor a = ((which % w).to(options) + 0.5 - cx) / fx;  // the ray, at unit depth
  const Tensor b = (torch::floor_divide(which, w).to(options) + 0.5 - cy) / fy;
  const Tensor gu = fx * pick(slope(drawn, 3));
  const Tensor gv = fy * pick(slope(drawn, 2));
  const Tensor along = a * gu + b * gv;
  const Tensor slopes = torch::stack(
      {gu / z, gv / z, -along / z, -gv - b * along, gu + a * along, a * gv - b * gu}, 1);
  const double half_w = 0.5 * static_cast<double>(w);
  const double half_h = 0.5 * static_cast<double>(h);
  return {.points = torch::stack({a * z, b * z, z}, 1),
          .drawn = pick(drawn),
          .slopes = slopes,
          .good = pick(level.good),
          .seen = without_mean(level.seen),
          .lens = torch::tensor({fx / half_w, fy / half_h, cx / half_w - 1.0, cy / half_h - 1.0},
                                options)
                      .view({2, 2}),
          .focal_px = fx,
          .share = static_cast<double>(which.size(0)) / static_cast<double>(h * w)};
}

/// Where a picture has points [n,3] before its camera [n,2], in halves of it from its middle.
Tensor places(const Pixels& pixels, const Tensor& points) {
  const Tensor z = points.select(1, 2).clamp_min(1e-3).unsqueeze(1);
  return points.slice(1, 0, 2) / z * pixels.lens[0] + pixels.lens[1];
}

/// How far aside a camera at `T` has the pixels' points, median [px].
double shift_px(const Pixels& pixels, const Tensor& T) {
  const Tensor points = moved(T.to(pixels.points.options()), pixels.points);
  const Tensor by = places(pixels, points) - places(pixels, pixels.points);
  const Tensor half = torch::tensor({pixels.seen.size(3), pixels.seen.size(2)}, by.options()) / 2.0;
  return (by * half).norm(2, 1).median().item<double>();
}

/// What the picture shows of the pixels' points from a camera at `T`, and where it shows them.
struct Sight {
  Tensor seen;
  Tensor visible;  ///< how far to trust it; 0 where it is not in the picture
};

Sight look(const Pixels& pixels, const Tensor& T) {
  const Tensor points = moved(T.to(pixels.points.options()), pixels.points);
  const Tensor at = places(pixels, points);
  constexpr std::int64_t kLinear = 0;
  constexpr std::int64_t kBorder = 1;
  const Tensor seen = torch::grid_sampler(pixels.seen, at.view({1, 1, -1, 2}), kLinear, kBorder,
                                          /*align_corners=*/false)
                          .flatten();
  const Tensor visible = (at.abs() < 1.0).all(1) & (points.select(1, 2) > 1e-3);
  return {seen, pixels.good * visible};
}

/// Residuals with their robust weights; the pictures' factor is estimated with them.
struct Comparison {
  Tensor residuals;
  Tensor weights;
  double sigma = 0.0;
  double mean = 0.0;  ///< of what is visible, large ones as the weights have them
  double correlation = 0.0;
};

Comparison compare(const Pixels& pixels, const Tensor& T) {
  const Sight sight = look(pixels, T);
  const Tensor products = torch::stack({(sight.visible * pixels.drawn * sight.seen).sum(),
                                        (sight.visible * sight.seen.square()).sum(),
                                        (sight.visible * pixels.drawn.square()).sum()})
                              .to(torch::kCPU, torch::kFloat64);
  const auto sums = products.accessor<double, 1>();
  const double gain = std::clamp(sums[0] / std::max(1e-12, sums[1]), kLeastGain, kMostGain);
  Comparison result;
  result.correlation = sums[0] / std::sqrt(std::max(1e-12, sums[1] * sums[2]));
  result.residuals = pixels.drawn - gain * sight.seen;
  const Tensor size = result.residuals.abs();
  result.sigma = std::max(kLeastSigma, 1.4826 * size.median().item<double>());
  result.weights = sight.visible * (kHuber * result.sigma / size.clamp_min(1e-9)).clamp_max(1.0);
  result.mean = ((result.weights * size).sum() / sight.visible.sum().clamp_min(1.0)).item<double>();
  return result;
}

/// The motion while it is sought: how far it is from where it was believed to be, too.
struct Estimate {
  Tensor T = torch::eye(4, torch::kFloat64);
  Tensor twist = torch::zeros({6}, torch::kFloat64);
};

void descend(const Pixels& pixels, const Tensor& prior, double depth, Estimate& estimate) {
  for (int k = 0; k < kMostSteps; ++k) {
    const Comparison now = compare(pixels, estimate.T);
    const Tensor weighted = pixels.slopes * now.weights.unsqueeze(1);
    const Tensor sums =
        torch::cat({weighted.t().mm(pixels.slopes), weighted.t().mm(now.residuals.unsqueeze(1))}, 1)
            .to(torch::kCPU, torch::kFloat64) /
        (kAlike * now.sigma * now.sigma);
    const Tensor information = sums.slice(1, 0, 6) + prior.diag();
    const Tensor pull = prior * estimate.twist - sums.select(1, 6);
    const Tensor step = torch::mv(torch::inverse(information), pull);
    estimate.T = estimate.T.mm(corrected_pose(torch::eye(4, torch::kFloat64), -step));
    estimate.twist = estimate.twist - step;
    const double change =
        step.slice(0, 0, 3).norm().item<double>() / depth + step.slice(0, 3).norm().item<double>();
    if (!(change * pixels.focal_px > kStill_px)) return;
  }
}

}  // namespace

std::optional<PictureAlignment> align_picture(const Picture& shown, const Tensor& picture,
                                              const splat::Intrinsics& intrinsics,
                                              const PoseSigmas& sigmas) {
  const torch::NoGradGuard no_grad;
  const double t = 1.0 / (sigmas.translation_m * sigmas.translation_m);
  const double r = 1.0 / (sigmas.rotation_rad * sigmas.rotation_rad);
  const Tensor prior = torch::tensor({t, t, t, r, r, r}, torch::kFloat64);
  const std::vector<Level> levels = pyramid(shown, picture);
  Estimate estimate;
  PictureAlignment result;
  double most = kBetter;
  for (auto level = levels.rbegin(); level != levels.rend(); ++level) {
    const Pixels pixels = compared(*level, intrinsics);
    if (pixels.share < kLeastShare) return std::nullopt;
    const double depth = pixels.points.select(1, 2).median().item<double>();
    descend(pixels, prior, depth, estimate);
    const Comparison now = compare(pixels, estimate.T);
    // Noise drowns it where pixels are small.
    result.likeness = std::max(result.likeness, now.correlation);
    if (std::next(level) != levels.rend()) continue;
    result.T_camera_believed = estimate.T;
    result.before = compare(pixels, torch::eye(4, torch::kFloat64)).mean;
    result.after = now.mean;
    result.share = pixels.share;
    if (shift_px(pixels, estimate.T) > kFar_px) most = kMuchBetter;
  }
  const double sigmas_off = (prior * estimate.twist.square()).sum().sqrt().item<double>();
  const bool fits = sigmas_off < kMostSigmas && result.likeness > kLeastLikeness &&
                    result.after < most * result.before;
  return fits ? std::optional(result) : std::nullopt;
}

}  // namespace apvi::mapping
