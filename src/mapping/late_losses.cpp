// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/late_losses.hpp"

#include <torch/torch.h>

#include "archive.hpp"

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

// What waits goes on waiting afterwards: draws depend on when a loss becomes known.
void LateLosses::save(torch::serialize::OutputArchive& archive) const {
  std::vector<std::int64_t> views;
  std::vector<torch::Tensor> losses;
  for (const auto& [view, loss] : waiting_) {
    views.push_back(static_cast<std::int64_t>(view));
    losses.push_back(loss);
  }
  archive.write("views", torch::tensor(views, torch::kInt64));
  archive.write("losses", losses.empty() ? torch::empty({0}) : torch::stack(losses));
  archive.write("newest", c10::IValue(newest_));
}

void LateLosses::load(torch::serialize::InputArchive& archive, const torch::Device& device) {
  torch::Tensor views, losses;
  archive.read("views", views);
  archive.read("losses", losses);
  const double newest = read_double(archive, "newest");
  TORCH_CHECK(
      views.sizes() == losses.sizes() && views.dim() == 1 && views.scalar_type() == torch::kInt64,
      "checkpoint: losses of ", losses.sizes(), " for views ", views.sizes());
  waiting_.clear();
  known_.clear();
  const auto view = views.accessor<std::int64_t, 1>();
  for (std::int64_t i = 0; i < views.size(0); ++i) {
    waiting_.emplace_back(static_cast<std::size_t>(view[i]), losses[i].to(device));
  }
  newest_ = newest;
}

std::vector<std::pair<std::size_t, double>> LateLosses::take() {
  return std::exchange(known_, {});
}

}  // namespace apvi::mapping
