// SPDX-License-Identifier: BSD-3-Clause
// Cost of a training step besides rendering: the photometric loss with its gradient, and Adam over
// all parameters of a map. The argument is the number of threads.
#include <ATen/Parallel.h>
#include <benchmark/benchmark.h>
#include <torch/torch.h>

#include "gaussians/metrics/losses.hpp"
#include "gaussians/model/gaussian_store.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

void photometric_loss_640x480(benchmark::State& state) {
  at::set_num_threads(static_cast<int>(state.range(0)));
  const Tensor image = torch::rand({480, 640, 3}).requires_grad_(true);
  const Tensor target = torch::rand({480, 640, 3});
  for ([[maybe_unused]] auto _ : state) {
    const Tensor loss = photometric_loss(image, target, 0.2);
    benchmark::DoNotOptimize(torch::autograd::grad({loss}, {image}));
  }
}
BENCHMARK(photometric_loss_640x480)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();

/// The number of Gaussians of the garden scene, with SH degree 3.
void adam_of_111785_gaussians(benchmark::State& state) {
  at::set_num_threads(static_cast<int>(state.range(0)));
  constexpr std::int64_t kCount = 111785;
  GaussianStore store({.means = torch::randn({kCount, 3}),
                       .log_scales = torch::randn({kCount, 3}),
                       .quaternions = torch::randn({kCount, 4}),
                       .logit_opacities = torch::randn({kCount}),
                       .sh_dc = torch::randn({kCount, 3}),
                       .sh_rest = torch::randn({kCount, sh_rest_count(3), 3})});
  std::vector<Tensor> gradients;
  for (const Tensor* leaf : store.view().tensors()) {
    gradients.push_back(torch::randn(leaf->sizes()) * 1e-5);
  }
  for ([[maybe_unused]] auto _ : state) {
    std::size_t k = 0;
    for (const Tensor* leaf : store.view().tensors()) leaf->mutable_grad() = gradients[k++];
    store.step({});
  }
}
BENCHMARK(adam_of_111785_gaussians)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace apvi::gaussians
