// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

namespace apvi::gaussians {

/// The values of a tensor in row-major order.
template <class T>
std::vector<T> host_values(const torch::Tensor& values) {
  constexpr auto kType = c10::CppTypeToScalarType<T>::value;
  const torch::Tensor host = values.detach().to(torch::kCPU, kType).contiguous();
  const T* const first = host.template data_ptr<T>();
  return {first, first + host.numel()};
}

}  // namespace apvi::gaussians
