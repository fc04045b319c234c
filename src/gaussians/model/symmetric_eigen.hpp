// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/torch.h>

#include <tuple>

namespace apvi::gaussians {

/// Eigenvalues [N,K], ascending, and eigenvectors [N,K,K], as columns, of symmetric matrices
/// [N,K,K]; on their device. Computed on the CPU: cuSOLVER fails for large batches of small ones.
inline std::tuple<torch::Tensor, torch::Tensor> symmetric_eigen(const torch::Tensor& matrices) {
  const auto [values, vectors] = torch::linalg_eigh(matrices.cpu());
  return {values.to(matrices.device()), vectors.to(matrices.device())};
}

}  // namespace apvi::gaussians
