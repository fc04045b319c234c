// SPDX-License-Identifier: BSD-3-Clause
#include "runs/quality/truth_errors.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "gaussians/metrics/metrics.hpp"
#include "gaussians/render/render.hpp"

namespace apvi::runs {
namespace {

constexpr double kSaturated = 250.0 / 255.0;

// Minimum transmittance, in the channel with the least attenuation, at which a surface counts as
// visible.
constexpr double kMinTransmittance = 0.05;

/// Where the image shows the scene, [H,W] bool: surfaces close enough, and open water.
torch::Tensor visibility_mask(const torch::Tensor& depth, const medium::Medium& water,
                              const gaussians::Intrinsics& camera) {
  const double min_attenuation = water.beta_d.min().item<double>();
  return gaussians::depth_to_range(depth, camera) < -std::log(kMinTransmittance) / min_attenuation;
}

double masked_psnr(const torch::Tensor& image, const torch::Tensor& truth,
                   const torch::Tensor& mask) {
  const torch::Tensor squares = (image - truth).square().mean(2);
  const double error = squares.index({mask}).mean().item<double>();
  return -10.0 * std::log10(std::max(1e-12, error));
}

/// Where the truth of a keyframe shows the scene, [H,W] bool; undefined if that is not known.
torch::Tensor visible_pixels(const std::optional<torch::Tensor>& depth,
                             const std::optional<medium::Medium>& water,
                             const gaussians::Intrinsics& camera) {
  return depth && water ? visibility_mask(*depth, *water, camera) : torch::Tensor();
}

/// Sums for the factors between restored light and the truth, by least squares.
struct FactorSums {
  torch::Tensor products = torch::zeros({3}, torch::kFloat64);
  torch::Tensor squares = torch::zeros({3}, torch::kFloat64);

  void add(const torch::Tensor& restored, const torch::Tensor& truth, const torch::Tensor& mask) {
    const torch::Tensor r = restored.index({mask}).to(torch::kFloat64);
    products += (r * truth.index({mask}).to(torch::kFloat64)).sum(0);
    squares += r.square().sum(0);
  }
  std::array<double, 3> factors() const {
    const torch::Tensor f = products / squares.clamp_min(1e-12);
    return {f[0].item<double>(), f[1].item<double>(), f[2].item<double>()};
  }
};

}  // namespace

TruthErrors compare(const mapping::MapRendering& rendering, const mapping::Keyframe& keyframe,
                    const SimulatedTruth& truth, const std::optional<medium::Medium>& water) {
  const auto cpu = [](const torch::Tensor& t) { return t.to(torch::kCPU, torch::kFloat32); };
  TruthErrors out;
  const auto depth = truth.depth(keyframe.name);
  const torch::Tensor visible = visible_pixels(depth, water, keyframe.intrinsics);
  if (depth) {
    if (const auto errors = gaussians::depth_errors(cpu(rendering.depth), *depth)) {
      out.depth_rmse_m = errors->rmse_m;
      out.depth_abs_rel = errors->abs_rel;
      out.depth_mean_m = depth->index({*depth > 0}).mean().item<double>();
    }
    out.depth_half_pixel_rmse_m = gaussians::half_pixel_depth_rmse(*depth);
    if (visible.defined()) {
      const auto errors = gaussians::depth_errors(cpu(rendering.depth), *depth * visible);
      if (errors) out.depth_seen_rmse_m = errors->rmse_m;
    }
  }
  if (const auto clear = truth.clear(keyframe.name)) {
    const torch::Tensor restored = cpu(rendering.restored).clamp(0.0, 1.0);
    const torch::Tensor expected = cpu(*clear) / 255.0;
    out.restored_psnr_db = gaussians::psnr(restored, expected);
    if (visible.defined() && visible.any().item<bool>()) {
      out.restored_seen_psnr_db = masked_psnr(restored, expected, visible);
    }
  }
  if (const auto moving = truth.moving(keyframe.name)) {
    const torch::Tensor still = *moving == 0;
    if (still.any().item<bool>()) {
      out.static_psnr_db =
          masked_psnr(cpu(rendering.color).clamp(0.0, 1.0), cpu(keyframe.image) / 255.0, still);
    }
  }
  return out;
}

std::optional<double> mean_of(const std::vector<TruthErrors>& views, const NamedError& column) {
  double sum = 0.0;
  int count = 0;
  for (const TruthErrors& view : views) {
    const auto& value = view.*column.value;
    if (!value) continue;
    sum += column.is_rmse ? *value * *value : *value;
    ++count;
  }
  if (count == 0) return std::nullopt;
  return column.is_rmse ? std::sqrt(sum / count) : sum / count;
}

std::optional<mapping::DisplayExposure> exposure_of_truth(const mapping::Map& map,
                                                          const mapping::KeyframeStore& keyframes,
                                                          const SimulatedTruth& truth) {
  if (!truth.has_own_exposure()) return std::nullopt;
  const auto water = truth.medium();
  FactorSums sums;
  for (const std::size_t i : keyframes.held_out()) {
    const mapping::Keyframe& keyframe = keyframes[i];
    const auto clear = truth.clear(keyframe.name);
    if (!clear) continue;
    const torch::Tensor values = *clear / 255.0;
    torch::Tensor mask = (values < kSaturated).all(2);
    const torch::Tensor visible =
        visible_pixels(truth.depth(keyframe.name), water, keyframe.intrinsics);
    if (visible.defined()) mask = mask & visible;
    const mapping::MapRendering rendering = mapping::render_map(map, keyframes.view(i, 1));
    sums.add(rendering.restored.to(torch::kCPU), map.tone_curve.decode(values), mask);
  }
  if (sums.squares.min().item<double>() <= 0.0) return std::nullopt;
  return mapping::DisplayExposure{.balance = sums.factors()};
}

}  // namespace apvi::runs
