// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/model/rows.hpp"

#include <torch/torch.h>

#include <cstddef>

namespace apvi::gaussians {

Gaussians on_device(const Gaussians& gaussians, const torch::Device& device) {
  Gaussians result = gaussians;
  for (torch::Tensor* tensor : result.tensors()) *tensor = tensor->to(device);
  return result;
}

Gaussians select(const Gaussians& gaussians, const torch::Tensor& rows) {
  Gaussians result = gaussians;
  for (torch::Tensor* tensor : result.tensors()) *tensor = tensor->index_select(0, rows);
  return result;
}

Gaussians join(const Gaussians& a, const Gaussians& b) {
  return join(std::vector<Gaussians>{a, b});
}

Gaussians join(const std::vector<Gaussians>& parts) {
  Gaussians result;
  for (std::size_t k = 0; k < result.tensors().size(); ++k) {
    std::vector<torch::Tensor> tensors;
    for (const Gaussians& part : parts) tensors.push_back(*part.tensors()[k]);
    *result.tensors()[k] = torch::cat(tensors);
  }
  return result;
}

}  // namespace apvi::gaussians
