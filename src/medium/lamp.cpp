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
constexpr std::int64_t kNumbersPerLamp = 8;
constexpr std::int64_t kSingleLampNumbers = 14;  // of files written for one lamp
constexpr double kMinCosIncidence = 0.2;         // limits grazing incidence

/// Terms that depend on geometry only, [...,1].
struct Beam {
  Tensor from;      ///< [...,3] from the lamp to the point
  Tensor distance;  ///< between them
  Tensor falloff;   ///< irradiance without attenuation: share beam (d_1 / d)^2
};

Beam beam_at(const Lamp& lamp, double unit_range_m, const Tensor& points) {
  const Tensor from = points - row(lamp.position_m, points);
  const Tensor d = from.norm(2, -1, true).clamp_min(kLampMinDistance_m);
  const Tensor cosine = (from * row(lamp.axis, points)).sum(-1, true) / d;
  const Tensor beam = torch::exp(lamp_sharpness(lamp) * (cosine - 1.0)) * (cosine > 0.0);
  return {.from = from, .distance = d, .falloff = lamp.share * beam * (unit_range_m / d).square()};
}

/// Steps grow with distance along a ray: step j ends at t = kLampMaxRange_m (j / kSteps)^2.
double end_of_step(std::int64_t j) {
  const double part = static_cast<double>(j) / static_cast<double>(kSteps);
  return kLampMaxRange_m * part * part;
}

/// Adds a term; the first one is taken.
void add(LampTerm& sum, const Tensor& value, const Tensor& derivative) {
  sum.value = sum.value.defined() ? sum.value + value : value;
  sum.derivative = sum.derivative.defined() ? sum.derivative + derivative : derivative;
}

}  // namespace

double lamp_sharpness(const Lamp& lamp) {
  return std::log(2.0) / (1.0 - std::cos(lamp.half_beam_rad));
}

Tensor lamp_to_tensor(const LampLight& light) {
  const auto flat = [](const Tensor& t) { return t.detach().to(torch::kCPU, torch::kFloat64); };
  const Tensor like = torch::empty({0}, torch::kFloat64);
  std::vector<Tensor> parts = {torch::tensor({light.unit_range_m}, torch::kFloat64),
                               flat(light.daylight), flat(light.backscatter)};
  for (const Lamp& lamp : light.lamps) {
    parts.push_back(row(lamp.position_m, like));
    parts.push_back(row(lamp.axis, like));
    parts.push_back(torch::tensor({lamp.half_beam_rad, lamp.share}, torch::kFloat64));
  }
  return torch::cat(parts);
}

bool is_lamp_tensor_size(std::int64_t count) {
  const std::int64_t lamps = (count - kCommonNumbers) / kNumbersPerLamp;
  return count == kSingleLampNumbers ||
         (lamps >= 1 && lamps <= static_cast<std::int64_t>(kMaxLamps) &&
          count == kCommonNumbers + kNumbersPerLamp * lamps);
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
  for (std::int64_t i = kCommonNumbers; i < flat.size(0); i += kNumbersPerLamp) {
    light.lamps.push_back({.position_m = {x[i], x[i + 1], x[i + 2]},
                           .axis = {x[i + 3], x[i + 4], x[i + 5]},
                           .half_beam_rad = x[i + 6],
                           .share = x[i + 7]});
  }
  return light;
}

LampTerm lamp_irradiance(const std::vector<Lamp>& lamps, double unit_range_m, const Tensor& beta_d,
                         const Tensor& points, const Tensor& normals) {
  LampTerm sum;
  for (const Lamp& lamp : lamps) {
    const Beam beam = beam_at(lamp, unit_range_m, points);
    const Tensor farther = beam.distance - unit_range_m;
    Tensor value = beam.falloff * torch::exp(-beta_d * farther);
    if (normals.defined()) {
      value =
          value *
          ((beam.from * normals).sum(-1, true) / beam.distance).abs().clamp_min(kMinCosIncidence);
    }
    add(sum, value, -farther * value);
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

LampBackscatterIntegral::LampBackscatterIntegral(const std::vector<Lamp>& lamps,
                                                 double unit_range_m, const Tensor& rays,
                                                 const Tensor& ranges) {
  for (const Lamp& lamp : lamps) {
    for (std::int64_t j = 0; j < kSteps; ++j) {
      const double begin = end_of_step(j);
      const Tensor length = (ranges - begin).clamp(0.0, end_of_step(j + 1) - begin).unsqueeze(-1);
      const Tensor middle = begin + 0.5 * length;
      const Beam beam = beam_at(lamp, unit_range_m, middle * rays);
      path_lengths_.push_back(beam.distance - unit_range_m + middle);
      weights_.push_back(beam.falloff * length);
    }
  }
}

// In place where possible: most of the time of a medium fit is spent here.
LampTerm LampBackscatterIntegral::at(const Tensor& beta_d) const {
  LampTerm sum;
  for (std::size_t j = 0; j < path_lengths_.size(); ++j) {
    const Tensor part = (beta_d * -path_lengths_[j]).exp_().mul_(weights_[j]);
    if (j == 0) {
      sum.value = part.clone();
      sum.derivative = path_lengths_[j] * part;
    } else {
      sum.value.add_(part);
      sum.derivative.addcmul_(path_lengths_[j], part);
    }
  }
  sum.derivative.neg_();
  return sum;
}

LampTerm lamp_backscatter_integral(const std::vector<Lamp>& lamps, double unit_range_m,
                                   const Tensor& beta_d, const Tensor& rays, const Tensor& ranges) {
  return LampBackscatterIntegral(lamps, unit_range_m, rays, ranges).at(beta_d);
}

Tensor lamp_light(const LampLight& light, const Tensor& beta_d, const Tensor& points) {
  const Tensor daylight = light.daylight.to(points.options());
  const Tensor irradiance =
      lamp_irradiance(light.lamps, light.unit_range_m, beta_d.to(points.options()), points).value;
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
    const Beam beam = beam_at(lamp, light.unit_range_m, middles * unit.unsqueeze(2));
    part += beam.falloff * lengths *
            torch::exp(-beta_d * (beam.distance - light.unit_range_m + middles));
  }
  part *= light.backscatter.to(options);
  const Tensor sums = torch::constant_pad_nd(part.cumsum(2), {0, 0, 1, 0});
  return sums.permute({3, 2, 0, 1}).unsqueeze(0).contiguous();
}

}  // namespace apvi::medium
