// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <functional>

/// Reference implementations in plain LibTorch, and comparison helpers.
namespace apvi::test {

/// Eq. (8) of the paper with alpha, differentiable by autograd.
inline torch::Tensor reference_medium(const torch::Tensor& color, const torch::Tensor& range,
                                      const torch::Tensor& alpha, const torch::Tensor& beta_d,
                                      const torch::Tensor& beta_b, const torch::Tensor& b_inf) {
  const torch::Tensor z = range.unsqueeze(-1);
  return color * torch::exp(-beta_d * z) +
         b_inf * (1.0 - alpha.unsqueeze(-1) * torch::exp(-beta_b * z));
}

/// Gradient of a scalar function by central differences; `x` float64 on the CPU.
inline torch::Tensor numeric_gradient(const std::function<torch::Tensor()>& loss,
                                      const torch::Tensor& x, double step = 1e-5) {
  const torch::NoGradGuard no_grad;
  torch::Tensor gradient = torch::zeros_like(x);
  auto* const value = x.data_ptr<double>();
  for (std::int64_t i = 0; i < x.numel(); ++i) {
    const double kept = value[i];
    value[i] = kept + step;
    const double above = loss().item<double>();
    value[i] = kept - step;
    const double below = loss().item<double>();
    value[i] = kept;
    gradient.data_ptr<double>()[i] = (above - below) / (2.0 * step);
  }
  return gradient;
}

/// Whether two tensors agree element by element: |a - b| <= tolerance (1 + |b|), and nothing is
/// NaN.
inline testing::AssertionResult tensors_near(const torch::Tensor& a, const torch::Tensor& b,
                                             double tolerance) {
  if (a.sizes() != b.sizes()) {
    return testing::AssertionFailure() << "shapes " << a.sizes() << " and " << b.sizes();
  }
  const torch::Tensor x = a.detach().to(torch::kCPU, torch::kFloat64);
  const torch::Tensor y = b.detach().to(torch::kCPU, torch::kFloat64);
  const double worst = ((x - y).abs() / (1.0 + y.abs())).max().item<double>();
  if (worst <= tolerance) return testing::AssertionSuccess();
  return testing::AssertionFailure() << "they differ by " << worst << ", allowed " << tolerance;
}

}  // namespace apvi::test
