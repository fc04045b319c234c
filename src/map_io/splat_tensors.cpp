// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/splat_tensors.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <vector>

namespace apvi::map_io {
namespace {

using torch::Tensor;

Tensor tensor_of(const std::vector<float>& values, at::IntArrayRef shape) {
  Tensor tensor = torch::empty(shape);
  std::copy(values.begin(), values.end(), tensor.data_ptr<float>());
  return tensor;
}

std::vector<float> values_of(const Tensor& tensor) {
  const Tensor t = tensor.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  return {t.data_ptr<float>(), t.data_ptr<float>() + t.numel()};
}

}  // namespace

gaussians::Gaussians to_gaussians(const Splats& splats) {
  const auto n = static_cast<std::int64_t>(splats.count);
  return {.means = tensor_of(splats.means, {n, 3}),
          .log_scales = tensor_of(splats.log_scales, {n, 3}),
          .quaternions = tensor_of(splats.quaternions, {n, 4}),
          .logit_opacities = tensor_of(splats.logit_opacities, {n}),
          .sh_dc = tensor_of(splats.sh_dc, {n, 3}),
          .sh_rest = tensor_of(splats.sh_rest, {n, static_cast<std::int64_t>(splats.rest), 3})};
}

Splats to_splats(const gaussians::Gaussians& gaussians) {
  Splats splats;
  splats.count = static_cast<std::size_t>(gaussians.size());
  splats.rest = static_cast<std::size_t>(gaussians.sh_rest.size(1));
  splats.means = values_of(gaussians.means);
  splats.log_scales = values_of(gaussians.log_scales);
  splats.quaternions = values_of(gaussians.quaternions);
  splats.logit_opacities = values_of(gaussians.logit_opacities);
  splats.sh_dc = values_of(gaussians.sh_dc);
  splats.sh_rest = values_of(gaussians.sh_rest);
  return splats;
}

}  // namespace apvi::map_io
