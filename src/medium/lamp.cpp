// SPDX-License-Identifier: BSD-3-Clause
#include "medium/lamp.hpp"

#include <torch/torch.h>

#include <cmath>
#include <cstdint>
#include <vector>

namespace apvi::medium {
namespace {

using torch::Tensor;

constexpr std::int64_t kSteps = 16;
constexpr std::int64_t kNodes = 20;  // of the table, per image dimension

Tensor row(const std::array<double, 3>& v, const Tensor& like) {
  return torch::tensor({v[0], v[1], v[2]}, torch::kFloat64).to(like.options().requires_grad(false));
}

constexpr std::int64_t kCommonNumbers = 7;
constexpr std::int64_t kNumbersPerLamp = 9;
constexpr std::int64_t kNumbersWithoutEdge = 8;  // per lamp, of files from before there was one
constexpr std::int64_t kSingleLampNumbers = 14;  // of files written for one lamp
constexpr double kMinCosIncidence = 0.2;         // limits grazing incidence

/// Where points are as seen from a lamp, [...,1] unless said otherwise.
struct LampPlace {
  Tensor from;       ///< [...,3] from the lamp to the point
  Tensor distance;   ///< between them
  Tensor one_minus;  ///< 1 - cos(angle from the axis)
  Tensor falloff;    ///< share (d_1 / d)^2
};

LampPlace place_at(const Lamp& lamp, double unit_range_m, const Tensor& points) {
  const Tensor from = points - row(lamp.position_m, points);
  const Tensor d = from.norm(2, -1, true).clamp_min(kLampMinDistance_m);
  const Tensor cosine = (from * row(lamp.axis, points)).sum(-1, true) / d;
  return {.from = from,
          .distance = d,
          .one_minus = 1.0 - cosine,
          .falloff = lamp.share * (unit_range_m / d).square()};
}

/// Intensity relative to the axis, of the same shape.
Tensor beam_at(const BeamProfile& profile, const Tensor& one_minus) {
  const Tensor loss = one_minus * (profile.linear + profile.square * one_minus);
  return torch::exp(-loss).mul_(one_minus < 1.0);
}

/// Steps grow with distance along a ray: step j ends at t = kLampMaxRange_m (j / kSteps)^2.
double end_of_step(std::int64_t j) {
  const double part = static_cast<double>(j) / static_cast<double>(kSteps);
  return kLampMaxRange_m * part * part;
}

/// Derivatives of the logarithm of a beam's intensity.
struct BeamDerivatives {
  Tensor by_half_beam;  ///< by the logarithm of the angle
  Tensor by_edge;
};

// In units of u = x / x_half the loss is ln 2 ((1 - e) u + e u^2).
BeamDerivatives beam_derivatives(const Lamp& lamp, const Tensor& one_minus) {
  const double half = lamp.half_beam_rad;
  const double x_half = 1.0 - std::cos(half);
  const Tensor u = one_minus / x_half;
  const double u_by_log_half = half * std::sin(half) / x_half;  // relative, negative
  return {
      .by_half_beam = std::log(2.0) * u_by_log_half * u * ((1.0 - lamp.edge) + 2.0 * lamp.edge * u),
      .by_edge = std::log(2.0) * u * (1.0 - u)};
}

}  // namespace

BeamProfile beam_profile(const Lamp& lamp) {
  const double x_half = 1.0 - std::cos(lamp.half_beam_rad);
  return {.linear = std::log(2.0) * (1.0 - lamp.edge) / x_half,
          .square = std::log(2.0) * lamp.edge / (x_half * x_half)};
}

Tensor lamp_to_tensor(const LampLight& light) {
  const auto flat = [](const Tensor& t) { return t.detach().to(torch::kCPU, torch::kFloat64); };
  const Tensor like = torch::empty({0}, torch::kFloat64);
  std::vector<Tensor> parts = {torch::tensor({light.unit_range_m}, torch::kFloat64),
                               flat(light.daylight), flat(light.backscatter)};
  for (const Lamp& lamp : light.lamps) {
    parts.push_back(row(lamp.position_m, like));
    parts.push_back(row(lamp.axis, like));
    parts.push_back(torch::tensor({lamp.half_beam_rad, lamp.edge, lamp.share}, torch::kFloat64));
  }
  return torch::cat(parts);
}

namespace {

/// Lamps that this many numbers describe with `each` per lamp; 0 if none.
std::int64_t lamp_count(std::int64_t numbers, std::int64_t each) {
  const std::int64_t lamps = (numbers - kCommonNumbers) / each;
  const bool fits = lamps >= 1 && lamps <= static_cast<std::int64_t>(kMaxLamps) &&
                    numbers == kCommonNumbers + each * lamps;
  return fits ? lamps : 0;
}

}  // namespace

bool is_lamp_tensor_size(std::int64_t count) {
  return count == kSingleLampNumbers || lamp_count(count, kNumbersPerLamp) > 0 ||
         lamp_count(count, kNumbersWithoutEdge) > 0;
}

LampLight lamp_from_tensor(const Tensor& numbers) {
  TORCH_CHECK(numbers.dim() == 1 && is_lamp_tensor_size(numbers.size(0)), "lamp: ", numbers.sizes(),
              " are not the numbers of up to ", kMaxLamps, " lamps");
  const Tensor flat = numbers.to(torch::kCPU, torch::kFloat64).contiguous();
  const double* x = flat.data_ptr<double>();
  if (flat.size(0) == kSingleLampNumbers) {
    return {.lamps = {{.position_m = {x[0], x[1], x[2]},
                       .axis = {x[3], x[4], x[5]},
                       .half_beam_rad = x[6]}},
            .unit_range_m = x[7],
            .daylight = flat.slice(0, 8, 11).clone(),
            .backscatter = flat.slice(0, 11, 14).clone()};
  }
  LampLight light = {.lamps = {},
                     .unit_range_m = x[0],
                     .daylight = flat.slice(0, 1, 4).clone(),
                     .backscatter = flat.slice(0, 4, 7).clone()};
  const bool has_edge = lamp_count(flat.size(0), kNumbersPerLamp) > 0;
  const std::int64_t each = has_edge ? kNumbersPerLamp : kNumbersWithoutEdge;
  for (std::int64_t i = kCommonNumbers; i < flat.size(0); i += each) {
    light.lamps.push_back({.position_m = {x[i], x[i + 1], x[i + 2]},
                           .axis = {x[i + 3], x[i + 4], x[i + 5]},
                           .half_beam_rad = x[i + 6],
                           .edge = has_edge ? x[i + 7] : 0.0,
                           .share = x[i + each - 1]});
  }
  return light;
}

LampSum LampSum::irradiance(const std::vector<Lamp>& lamps, double unit_range_m,
                            const Tensor& points, const Tensor& normals) {
  LampSum sum;
  for (std::size_t i = 0; i < lamps.size(); ++i) {
    const LampPlace place = place_at(lamps[i], unit_range_m, points);
    Tensor weight = place.falloff;
    if (normals.defined()) {
      weight =
          weight *
          ((place.from * normals).sum(-1, true) / place.distance).abs().clamp_min(kMinCosIncidence);
    }
    sum.parts_.push_back({i, weight, place.distance - unit_range_m, place.one_minus});
  }
  return sum;
}

Tensor distance_from_lamps(const std::vector<Lamp>& lamps, const Tensor& points) {
  Tensor sum = torch::zeros_like(points.select(-1, 0));
  for (const Lamp& lamp : lamps) {
    sum += lamp.share * (points - row(lamp.position_m, points)).norm(2, -1);
  }
  return sum;
}

LampSum LampSum::backscatter(const std::vector<Lamp>& lamps, double unit_range_m,
                             const Tensor& rays, const Tensor& ranges) {
  LampSum sum;
  for (std::size_t i = 0; i < lamps.size(); ++i) {
    for (std::int64_t j = 0; j < kSteps; ++j) {
      const double begin = end_of_step(j);
      const Tensor length = (ranges - begin).clamp(0.0, end_of_step(j + 1) - begin).unsqueeze(-1);
      const Tensor middle = begin + 0.5 * length;
      const LampPlace place = place_at(lamps[i], unit_range_m, middle * rays);
      sum.parts_.push_back(
          {i, place.falloff * length, place.distance - unit_range_m + middle, place.one_minus});
    }
  }
  return sum;
}

// In place where possible: most of the time of a medium fit is spent here.
LampTerm LampSum::at(const Tensor& beta_d, const std::vector<Lamp>& lamps,
                     bool with_derivatives) const {
  const auto zero = [&] {
    const Tensor& path = parts_.front().path;
    return torch::zeros_like(path * beta_d);
  };
  LampTerm sum = {.value = zero(), .by_beta_d = {}, .by_half_beam = {}, .by_edge = {}};
  if (with_derivatives) {
    for (Tensor* derivative : {&sum.by_beta_d, &sum.by_half_beam, &sum.by_edge})
      *derivative = zero();
  }
  for (const Part& part : parts_) {
    const Lamp& lamp = lamps[part.lamp];
    const Tensor weight = beam_at(beam_profile(lamp), part.one_minus).mul_(part.weight);
    const Tensor light = (beta_d * -part.path).exp_().mul_(weight);
    sum.value.add_(light);
    if (!with_derivatives) continue;
    const BeamDerivatives beam = beam_derivatives(lamp, part.one_minus);
    sum.by_beta_d.addcmul_(part.path, light, -1.0);
    sum.by_half_beam.addcmul_(beam.by_half_beam, light);
    sum.by_edge.addcmul_(beam.by_edge, light);
  }
  return sum;
}

Tensor lamp_light(const LampLight& light, const Tensor& beta_d, const Tensor& points) {
  const Tensor daylight = light.daylight.to(points.options());
  const Tensor irradiance = LampSum::irradiance(light.lamps, light.unit_range_m, points)
                                .at(beta_d.to(points.options()), light.lamps)
                                .value;
  return daylight + (1.0 - daylight) * irradiance;
}

Tensor lamp_backscatter_table(const LampLight& light, const Tensor& beta_d,
                              const gaussians::Intrinsics& camera) {
  const auto options = beta_d.options();
  const Tensor u = torch::linspace(0.0, camera.width, kNodes, options);
  const Tensor v = torch::linspace(0.0, camera.height, kNodes, options);
  const Tensor x = ((u - camera.cx) / camera.fx).unsqueeze(0).expand({kNodes, kNodes});
  const Tensor y = ((v - camera.cy) / camera.fy).unsqueeze(1).expand({kNodes, kNodes});
  const Tensor rays = torch::stack({x, y, torch::ones_like(x)}, 2);
  const Tensor unit = rays / rays.norm(2, 2, true);
  const Tensor ends =
      kLampMaxRange_m *
      (torch::arange(kSteps + 1, options) / static_cast<double>(kSteps)).square().view({-1, 1});
  const Tensor middles = 0.5 * (ends.slice(0, 1) + ends.slice(0, 0, -1));
  const Tensor lengths = ends.slice(0, 1) - ends.slice(0, 0, -1);
  Tensor part = torch::zeros({kNodes, kNodes, kSteps, 3}, options);
  for (const Lamp& lamp : light.lamps) {
    const LampPlace place = place_at(lamp, light.unit_range_m, middles * unit.unsqueeze(2));
    part += place.falloff * beam_at(beam_profile(lamp), place.one_minus) * lengths *
            torch::exp(-beta_d * (place.distance - light.unit_range_m + middles));
  }
  part *= light.backscatter.to(options);
  const Tensor sums = torch::constant_pad_nd(part.cumsum(2), {0, 0, 1, 0});
  return sums.permute({3, 2, 0, 1}).unsqueeze(0).contiguous();
}

}  // namespace apvi::medium
