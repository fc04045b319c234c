// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/view_gains.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "apvi/mapping/step_backend.hpp"

namespace apvi::mapping {

using torch::Tensor;

namespace {

constexpr double kChangeLasts = 3.0;     // [s] until a change says a third of what it did
constexpr double kDarkestCorner = 0.05;  // an estimate may not turn a lens opaque

/// How much the readings at `before` and `after` say about a moment `t` [s], the nearer the more.
std::pair<double, double> sway(double before, double t, double after) {
  const double left = std::max(0.0, t - before) / kChangeLasts;
  const double right = std::max(0.0, after - t) / kChangeLasts;
  if (left == 0.0) return {1.0, 0.0};
  if (right == 0.0) return {0.0, 1.0};
  // sinh(right) / sinh(left + right) and the reverse, which cannot overflow.
  const double both = -std::expm1(-2.0 * (left + right));
  return {std::exp(-left) * -std::expm1(-2.0 * right) / both,
          std::exp(-right) * -std::expm1(-2.0 * left) / both};
}

}  // namespace

Tensor corners2(const splat::Intrinsics& camera, const Tensor& x, const Tensor& y) {
  const double corner2 = 0.25 * (static_cast<double>(camera.width) * camera.width +
                                 static_cast<double>(camera.height) * camera.height);
  const Tensor dx2 = (x - camera.cx).square();
  const Tensor dy2 = (y - camera.cy).square();
  const Tensor t = dx2 / (camera.fx * camera.fx) + dy2 / (camera.fy * camera.fy);
  const auto& [a, b, c] = camera.lens_spread;
  return (dx2 + dy2) / corner2 * (1.0 + t * (a + t * (b + t * c)));
}

Tensor lens_falloff(const splat::Intrinsics& camera, double vignetting, const Tensor& x,
                    const Tensor& y) {
  return (1.0 - vignetting * corners2(camera, x, y)).clamp_min(kDarkestCorner);
}

Tensor lens_falloff(const splat::Intrinsics& camera, double vignetting,
                    const torch::Device& device) {
  const auto options = torch::dtype(torch::kFloat32).device(device);
  const Tensor x = torch::arange(camera.width, options) + 0.5;
  const Tensor y = torch::arange(camera.height, options) + 0.5;
  return lens_falloff(camera, vignetting, x, y.unsqueeze(1)).unsqueeze(2);
}

ViewGains::ViewGains(std::size_t views, const torch::Device& device)
    : logs_(torch::zeros({static_cast<std::int64_t>(views)},
                         torch::dtype(torch::kFloat32).device(device))),
      usual_(torch::zeros({2}, logs_.options())) {}

void ViewGains::add_view() {
  const std::int64_t n = logs_.size(0);
  const Tensor next = n > 0 ? logs_.narrow(0, n - 1, 1) : torch::zeros({1}, logs_.options());
  logs_ = torch::cat({logs_, next});
}

void ViewGains::find(std::size_t view, const DrawnView& drawn, const Tensor& picture) {
  match(view, drawn, picture, kGainFound, usual_.narrow(0, 0, 1));
}

void ViewGains::follow(std::size_t view, const DrawnView& drawn, const Tensor& picture) {
  match(view, drawn, picture, kGainFollowed, usual_.narrow(0, 1, 1));
}

// Sums, not least squares: a map that is not sharp yet would look too bright to them.
void ViewGains::match(std::size_t view, const DrawnView& drawn, const Tensor& picture,
                      const GainPace& pace, const Tensor& usual) {
  step_backend(logs_.device())
      .match_gain({.drawn = drawn.image,
                   .alpha = drawn.alpha,
                   .picture = picture,
                   .water = drawn.open_water,
                   .horizon = drawn.horizon,
                   .log_gain = log_gain(view),
                   .usual = usual,
                   .pace = pace});
}

Tensor ViewGains::log_gain(std::size_t view) const {
  return logs_.narrow(0, static_cast<std::int64_t>(view), 1);
}

Tensor surveyed_gains(const Tensor& logs, const std::vector<double>& seconds,
                      const std::vector<std::size_t>& views, const Tensor& found) {
  const std::vector<std::int64_t> which(views.begin(), views.end());
  const Tensor changes = found - logs.index_select(0, torch::tensor(which, torch::kInt64));
  const double usual = changes.median().item<double>();
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
    const auto [left, right] = sway(before, seconds[i], after);
    double moved = usual;
    if (next > 0) moved += left * (change[static_cast<std::int64_t>(next) - 1] - usual);
    if (!is_last) moved += right * (change[static_cast<std::int64_t>(next)] - usual);
    log[static_cast<std::int64_t>(i)] += moved;
  }
  return result;
}

void ViewGains::save(torch::serialize::OutputArchive& archive) const {
  archive.write("logs", logs_.clone());
  archive.write("usual", usual_);
}

void ViewGains::load(torch::serialize::InputArchive& archive) {
  Tensor logs;
  archive.read("logs", logs);
  TORCH_CHECK(logs.dim() == 1 && logs.size(0) == logs_.size(0), "checkpoint: gains of ",
              logs.numel(), " keyframes instead of ", logs_.size(0));
  logs_ = logs.to(logs_.options());
  Tensor usual;
  archive.read("usual", usual);
  usual_ = usual.to(usual_.options());
}

}  // namespace apvi::mapping
