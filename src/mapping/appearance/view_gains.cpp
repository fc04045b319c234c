// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/appearance/view_gains.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "mapping/training/step_backend.hpp"

namespace apvi::mapping {

using torch::Tensor;

namespace {

constexpr double kCorrelationTime_s = 3.0;  // of changes of the gain
constexpr double kMinFalloff = 0.05;        // bounds the falloff of a bad vignetting estimate

/// Weights at time `t` [s] of the observations at `before` and `after`.
std::pair<double, double> interpolation_weights(double before, double t, double after) {
  const double left = std::max(0.0, t - before) / kCorrelationTime_s;
  const double right = std::max(0.0, after - t) / kCorrelationTime_s;
  if (left == 0.0) return {1.0, 0.0};
  if (right == 0.0) return {0.0, 1.0};
  // sinh(right) / sinh(left + right) and vice versa, without overflow.
  const double both = -std::expm1(-2.0 * (left + right));
  return {std::exp(-left) * -std::expm1(-2.0 * right) / both,
          std::exp(-right) * -std::expm1(-2.0 * left) / both};
}

}  // namespace

Tensor corners2(const gaussians::Intrinsics& camera, const Tensor& x, const Tensor& y) {
  const double corner2 = 0.25 * (static_cast<double>(camera.width) * camera.width +
                                 static_cast<double>(camera.height) * camera.height);
  const Tensor dx2 = (x - camera.cx).square();
  const Tensor dy2 = (y - camera.cy).square();
  const Tensor t = dx2 / (camera.fx * camera.fx) + dy2 / (camera.fy * camera.fy);
  const auto& [a, b, c] = camera.lens_spread;
  return (dx2 + dy2) / corner2 * (1.0 + t * (a + t * (b + t * c)));
}

Tensor lens_falloff(const gaussians::Intrinsics& camera, const medium::Vignetting& vignetting,
                    const Tensor& x, const Tensor& y) {
  return vignetting.factor(corners2(camera, x, y)).clamp_min(kMinFalloff);
}

Tensor lens_falloff(const gaussians::Intrinsics& camera, const medium::Vignetting& vignetting,
                    const torch::Device& device) {
  const auto options = torch::dtype(torch::kFloat32).device(device);
  const Tensor x = torch::arange(camera.width, options) + 0.5;
  const Tensor y = torch::arange(camera.height, options) + 0.5;
  return lens_falloff(camera, vignetting, x, y.unsqueeze(1)).unsqueeze(2);
}

ViewGains::ViewGains(std::size_t views, const torch::Device& device)
    : logs_(torch::zeros({static_cast<std::int64_t>(views)},
                         torch::dtype(torch::kFloat32).device(device))),
      bias_(torch::zeros({2}, logs_.options())) {}

void ViewGains::add_view() {
  const std::int64_t n = logs_.size(0);
  const Tensor next = n > 0 ? logs_.narrow(0, n - 1, 1) : torch::zeros({1}, logs_.options());
  logs_ = torch::cat({logs_, next});
}

void ViewGains::initialize(std::size_t view, const RenderedView& rendered, const Tensor& image) {
  update(view, rendered, image, kNewViewGainUpdate, bias_.narrow(0, 0, 1));
}

void ViewGains::measure(std::size_t view, const RenderedView& rendered, const Tensor& image) {
  update(view, rendered, image, kFinishedMapGainUpdate, torch::zeros({1}, logs_.options()));
}

void ViewGains::track(std::size_t view, const RenderedView& rendered, const Tensor& image) {
  update(view, rendered, image, kKnownViewGainUpdate, bias_.narrow(0, 1, 1));
}

// Ratio of sums: least squares would be biased by a blurred map.
void ViewGains::update(std::size_t view, const RenderedView& rendered, const Tensor& image,
                       const GainUpdate& options, const Tensor& bias) {
  step_backend(logs_.device())
      .match_gain({.drawn = rendered.image,
                   .alpha = rendered.alpha,
                   .image = image,
                   .water = rendered.open_water,
                   .horizon = rendered.horizon,
                   .log_gain = log_gain(view),
                   .bias = bias,
                   .update = options});
}

void ViewGains::hold_median(const std::vector<std::size_t>& views) {
  held_ = torch::tensor(std::vector<std::int64_t>(views.begin(), views.end()), torch::kInt64)
              .to(logs_.device());
  median_ = logs_.index_select(0, held_).median();
}

void ViewGains::restore_median() {
  if (held_.defined()) logs_.add_(median_ - logs_.index_select(0, held_).median());
}

Tensor ViewGains::log_gain(std::size_t view) const {
  return logs_.narrow(0, static_cast<std::int64_t>(view), 1);
}

Tensor interpolate_gains(const Tensor& logs, const std::vector<double>& seconds,
                         const std::vector<std::size_t>& views, const Tensor& estimated) {
  const std::vector<std::int64_t> which(views.begin(), views.end());
  const Tensor changes = estimated - logs.index_select(0, torch::tensor(which, torch::kInt64));
  const double median = changes.median().item<double>();
  const auto change = changes.accessor<double, 1>();
  constexpr double kNever = std::numeric_limits<double>::infinity();
  Tensor result = logs.clone();
  auto log = result.accessor<double, 1>();
  std::size_t next = 0;
  for (std::size_t i = 0; i < seconds.size(); ++i) {
    while (next < views.size() && views[next] < i) ++next;
    const bool is_last = next == views.size();
    const double before = next == 0 ? -kNever : seconds[views[next - 1]];
    const double after = is_last ? kNever : seconds[views[next]];
    const auto [left, right] = interpolation_weights(before, seconds[i], after);
    double delta = median;
    if (next > 0) delta += left * (change[static_cast<std::int64_t>(next) - 1] - median);
    if (!is_last) delta += right * (change[static_cast<std::int64_t>(next)] - median);
    log[static_cast<std::int64_t>(i)] += delta;
  }
  return result;
}

void ViewGains::save(torch::serialize::OutputArchive& archive) const {
  archive.write("logs", logs_.clone());
  archive.write("bias", bias_);
}

void ViewGains::load(torch::serialize::InputArchive& archive) {
  Tensor logs;
  archive.read("logs", logs);
  TORCH_CHECK(logs.dim() == 1 && logs.size(0) == logs_.size(0), "checkpoint: gains of ",
              logs.numel(), " keyframes instead of ", logs_.size(0));
  logs_ = logs.to(logs_.options());
  Tensor bias;
  archive.read("bias", bias);
  bias_ = bias.to(bias_.options());
}

}  // namespace apvi::mapping
