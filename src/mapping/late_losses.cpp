// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/late_losses.hpp"

#include <torch/torch.h>

namespace apvi::mapping {
namespace {

constexpr std::size_t kAtOnce = 16;

}  // namespace

void LateLosses::add(std::size_t view, const torch::Tensor& loss) {
  waiting_.emplace_back(view, loss.detach().reshape({}));
  if (loss.is_cpu() || waiting_.size() >= kAtOnce) read();
}

void LateLosses::read() {
  std::vector<torch::Tensor> losses;
  for (const auto& [view, loss] : waiting_) losses.push_back(loss);
  const torch::Tensor values = torch::stack(losses).to(torch::kCPU, torch::kFloat64);
  for (std::size_t i = 0; i < waiting_.size(); ++i) {
    newest_ = values.data_ptr<double>()[i];
    known_.emplace_back(waiting_[i].first, newest_);
  }
  waiting_.clear();
}

std::vector<std::pair<std::size_t, double>> LateLosses::take() {
  return std::exchange(known_, {});
}

}  // namespace apvi::mapping
