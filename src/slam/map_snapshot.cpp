// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/slam/map_snapshot.hpp"

#include <torch/torch.h>

#include "gaussians/device.hpp"
#include "gaussians/host_values.hpp"
#include "slam/map_access.hpp"

namespace apvi::slam {
namespace {

using gaussians::host_values;
using torch::Tensor;

std::array<double, 3> to_array(const Tensor& rgb) {
  const Tensor v = rgb.detach().to(torch::kCPU, torch::kFloat64).contiguous();
  const double* const x = v.data_ptr<double>();
  return {x[0], x[1], x[2]};
}

MediumCoefficients to_coefficients(const medium::Medium& medium) {
  MediumCoefficients out = {.beta_d = to_array(medium.beta_d),
                            .beta_b = to_array(medium.beta_b),
                            .b_inf = to_array(medium.b_inf)};
  if (const auto& light = medium.lamp) {
    out.lamp = {.lamps = light->lamps,
                .unit_range_m = light->unit_range_m,
                .daylight = to_array(light->daylight),
                .backscatter = to_array(light->backscatter)};
  }
  return out;
}

Tensor to_tensor(const std::vector<float>& values, std::vector<std::int64_t> shape,
                 const char* name) {
  std::int64_t count = 1;
  for (const std::int64_t n : shape) count *= n;
  if (static_cast<std::size_t>(count) != values.size()) {
    fail_input("map: {} has {} numbers instead of {}", name, values.size(), count);
  }
  return torch::tensor(values, torch::kFloat32).reshape(shape);
}

Tensor to_tensor(const std::array<double, 3>& rgb) {
  return torch::tensor({rgb[0], rgb[1], rgb[2]}, torch::kFloat64).to(torch::kFloat32);
}

medium::Medium to_medium(const MediumCoefficients& water) {
  medium::Medium out = {.beta_d = to_tensor(water.beta_d),
                        .beta_b = to_tensor(water.beta_b),
                        .b_inf = to_tensor(water.b_inf)};
  if (const auto& light = water.lamp) {
    out.lamp = {.lamps = light->lamps,
                .unit_range_m = light->unit_range_m,
                .daylight = to_tensor(light->daylight),
                .backscatter = to_tensor(light->backscatter)};
  }
  return out;
}

}  // namespace

MapSnapshot to_snapshot(const MapCopy& copy) {
  const gaussians::Gaussians& g = copy.map.gaussians;
  const Tensor sh = torch::cat({g.sh_dc.unsqueeze(1), g.sh_rest}, 1);
  MapSnapshot out = {.iteration = copy.iteration,
                     .count = static_cast<std::size_t>(g.size()),
                     .means = host_values<float>(g.means),
                     .log_scales = host_values<float>(g.log_scales),
                     .quaternions = host_values<float>(g.quaternions),
                     .logit_opacities = host_values<float>(g.logit_opacities),
                     .sh_coefficients = static_cast<std::size_t>(sh.size(1)),
                     .spherical_harmonics = host_values<float>(sh),
                     .medium = std::nullopt,
                     .keyframes = copy.keyframes,
                     .tone_curve = {copy.map.tone_curve.gamma, copy.map.tone_curve.offset},
                     .vignetting = {copy.map.vignetting.square, copy.map.vignetting.fourth},
                     .antialiased = copy.map.antialiased};
  if (copy.map.medium) out.medium = to_coefficients(*copy.map.medium);
  return out;
}

mapping::Map to_map(const MapSnapshot& snapshot) {
  const auto n = static_cast<std::int64_t>(snapshot.count);
  const auto k = static_cast<std::int64_t>(snapshot.sh_coefficients);
  if (k != 1 && k != 4 && k != 9 && k != 16) {
    fail_input("map: {} coefficients of spherical harmonics instead of 1, 4, 9 or 16", k);
  }
  const Tensor sh = to_tensor(snapshot.spherical_harmonics, {n, k, 3}, "spherical_harmonics");
  mapping::Map map;
  map.gaussians = {.means = to_tensor(snapshot.means, {n, 3}, "means"),
                   .log_scales = to_tensor(snapshot.log_scales, {n, 3}, "log_scales"),
                   .quaternions = to_tensor(snapshot.quaternions, {n, 4}, "quaternions"),
                   .logit_opacities = to_tensor(snapshot.logit_opacities, {n}, "logit_opacities"),
                   .sh_dc = sh.select(1, 0).contiguous(),
                   .sh_rest = sh.slice(1, 1).contiguous()};
  if (snapshot.medium) map.medium = to_medium(*snapshot.medium);
  map.antialiased = snapshot.antialiased;
  map.tone_curve = {.gamma = snapshot.tone_curve.gamma, .offset = snapshot.tone_curve.offset};
  map.vignetting = {.square = snapshot.vignetting.square, .fourth = snapshot.vignetting.fourth};
  return map;
}

}  // namespace apvi::slam
