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
  Gaussians result = a;
  for (std::size_t k = 0; k < result.tensors().size(); ++k) {
    *result.tensors()[k] = torch::cat({*a.tensors()[k], *b.tensors()[k]});
  }
  return result;
}

}  // namespace apvi::gaussians
