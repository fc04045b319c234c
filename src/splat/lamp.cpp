// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/splat/lamp.hpp"

#include <torch/torch.h>

#include <cmath>
#include <cstdint>
#include <vector>

namespace apvi::splat {
namespace {

using torch::Tensor;

constexpr std::int64_t kSteps = 16;
constexpr std::int64_t kNodes = 20;  // of a picture, each way

Tensor row(const std::array<double, 3>& v, const Tensor& like) {
  return torch::tensor({v[0], v[1], v[2]}, torch::kFloat64).to(like.options().requires_grad(false));
}

/// What geometry alone says of points: distance to the lamp and brightness there, [...,1].
struct Beam {
  Tensor distance;
  Tensor falloff;  ///< beam (d_1 / d)^2
};

Beam beam_at(const Lamp& lamp, double unit_range_m, const Tensor& points) {
  const Tensor from = points - row(lamp.position_m, points);
  const Tensor d = from.norm(2, -1, true).clamp_min(kLampNearest_m);
  const Tensor cosine = (from * row(lamp.axis, points)).sum(-1, true) / d;
  const Tensor beam = torch::exp(lamp_sharpness(lamp) * (cosine - 1.0)) * (cosine > 0.0);
  return {.distance = d, .falloff = beam * (unit_range_m / d).square()};
}

/// Along a ray the steps grow with distance: t = kLampReach_m (j / kSteps)^2 at the ends of step j.
double end_of_step(std::int64_t j) {
  const double part = static_cast<double>(j) / static_cast<double>(kSteps);
  return kLampReach_m * part * part;
}

}  // namespace

double lamp_sharpness(const Lamp& lamp) {
  return std::log(2.0) / (1.0 - std::cos(lamp.half_beam_rad));
}

Tensor to_numbers(const LampLight& light) {
  const auto flat = [](const Tensor& t) { return t.detach().to(torch::kCPU, torch::kFloat64); };
  const Tensor like = torch::empty({0}, torch::kFloat64);
  return torch::cat({row(light.lamp.position_m, like), row(light.lamp.axis, like),
                     torch::tensor({light.lamp.half_beam_rad, light.unit_range_m}, torch::kFloat64),
                     flat(light.daylight), flat(light.glow)});
}

LampLight lamp_from_numbers(const Tensor& numbers) {
  TORCH_CHECK(numbers.sizes() == at::IntArrayRef({kLampNumbers}), "lamp: expected ", kLampNumbers,
              " numbers, got ", numbers.sizes());
  const Tensor flat = numbers.to(torch::kCPU, torch::kFloat64).contiguous();
  const double* x = flat.data_ptr<double>();
  return {
      .lamp = {.position_m = {x[0], x[1], x[2]}, .axis = {x[3], x[4], x[5]}, .half_beam_rad = x[6]},
      .unit_range_m = x[7],
      .daylight = flat.slice(0, 8, 11).clone(),
      .glow = flat.slice(0, 11, 14).clone()};
}

LampTerm lamp_shine(const Lamp& lamp, double unit_range_m, const Tensor& beta_d,
                    const Tensor& points) {
  const Beam beam = beam_at(lamp, unit_range_m, points);
  const Tensor farther = beam.distance - unit_range_m;
  const Tensor value = beam.falloff * torch::exp(-beta_d * farther);
  return {.value = value, .by_beta_d = -farther * value};
}

LampHaze::LampHaze(const Lamp& lamp, double unit_range_m, const Tensor& rays,
                   const Tensor& ranges) {
  for (std::int64_t j = 0; j < kSteps; ++j) {
    const double begin = end_of_step(j);
    const Tensor length = (ranges - begin).clamp(0.0, end_of_step(j + 1) - begin).unsqueeze(-1);
    const Tensor middle = begin + 0.5 * length;
    const Beam beam = beam_at(lamp, unit_range_m, middle * rays);
    ways_.push_back(beam.distance - unit_range_m + middle);
    weights_.push_back(beam.falloff * length);
  }
}

// In place where it can be: this is most of what fitting water takes.
LampTerm LampHaze::at(const Tensor& beta_d) const {
  LampTerm sum;
  for (std::size_t j = 0; j < ways_.size(); ++j) {
    const Tensor part = (beta_d * -ways_[j]).exp_().mul_(weights_[j]);
    if (j == 0) {
      sum.value = part.clone();
      sum.by_beta_d = ways_[j] * part;
    } else {
      sum.value.add_(part);
      sum.by_beta_d.addcmul_(ways_[j], part);
    }
  }
  sum.by_beta_d.neg_();
  return sum;
}

LampTerm lamp_haze(const Lamp& lamp, double unit_range_m, const Tensor& beta_d, const Tensor& rays,
                   const Tensor& ranges) {
  return LampHaze(lamp, unit_range_m, rays, ranges).at(beta_d);
}

Tensor lamp_light(const LampLight& light, const Tensor& beta_d, const Tensor& points) {
  const Tensor daylight = light.daylight.to(points.options());
  const Tensor shine =
      lamp_shine(light.lamp, light.unit_range_m, beta_d.to(points.options()), points).value;
  return daylight + (1.0 - daylight) * shine;
}

Tensor lamp_haze_table(const LampLight& light, const Tensor& beta_d, const Intrinsics& camera) {
  const auto options = beta_d.options();
  const Tensor u = torch::linspace(0.0, camera.width, kNodes, options);
  const Tensor v = torch::linspace(0.0, camera.height, kNodes, options);
  const Tensor x = ((u - camera.cx) / camera.fx).unsqueeze(0).expand({kNodes, kNodes});
  const Tensor y = ((v - camera.cy) / camera.fy).unsqueeze(1).expand({kNodes, kNodes});
  const Tensor rays = torch::stack({x, y, torch::ones_like(x)}, 2);
  const Tensor unit = rays / rays.norm(2, 2, true);
  const Tensor ends =
      kLampReach_m *
      (torch::arange(kSteps + 1, options) / static_cast<double>(kSteps)).square().view({-1, 1});
  const Tensor middles = 0.5 * (ends.slice(0, 1) + ends.slice(0, 0, -1));
  const Tensor lengths = ends.slice(0, 1) - ends.slice(0, 0, -1);
  const Beam beam = beam_at(light.lamp, light.unit_range_m, middles * unit.unsqueeze(2));
  const Tensor part = light.glow.to(options) * beam.falloff * lengths *
                      torch::exp(-beta_d * (beam.distance - light.unit_range_m + middles));
  const Tensor sums = torch::constant_pad_nd(part.cumsum(2), {0, 0, 1, 0});
  return sums.permute({3, 2, 0, 1}).unsqueeze(0).contiguous();
}

}  // namespace apvi::splat
