// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/training/deferred_loss_readback.hpp"

#include <torch/torch.h>

#include "gaussians/model/archive.hpp"

namespace apvi::mapping {
namespace {

constexpr std::size_t kReadbackBatch = 16;

}  // namespace

void DeferredLossReadback::add(std::size_t view, const torch::Tensor& loss) {
  pending_.emplace_back(view, loss.detach().reshape({}));
  if (loss.is_cpu() || pending_.size() >= kReadbackBatch) read();
}

void DeferredLossReadback::read() {
  std::vector<torch::Tensor> losses;
  for (const auto& [view, loss] : pending_) losses.push_back(loss);
  const torch::Tensor values = torch::stack(losses).to(torch::kCPU, torch::kFloat64);
  for (std::size_t i = 0; i < pending_.size(); ++i) {
    newest_ = values.data_ptr<double>()[i];
    ready_.emplace_back(pending_[i].first, newest_);
  }
  pending_.clear();
}

// Pending losses stay pending, because view sampling depends on when a loss becomes available.
void DeferredLossReadback::save(torch::serialize::OutputArchive& archive) const {
  std::vector<std::int64_t> views;
  std::vector<torch::Tensor> losses;
  for (const auto& [view, loss] : pending_) {
    views.push_back(static_cast<std::int64_t>(view));
    losses.push_back(loss);
  }
  archive.write("views", torch::tensor(views, torch::kInt64));
  archive.write("losses", losses.empty() ? torch::empty({0}) : torch::stack(losses));
  archive.write("newest", c10::IValue(newest_));
}

void DeferredLossReadback::load(torch::serialize::InputArchive& archive,
                                const torch::Device& device) {
  torch::Tensor views, losses;
  archive.read("views", views);
  archive.read("losses", losses);
  const double newest = gaussians::read_double(archive, "newest");
  TORCH_CHECK(
      views.sizes() == losses.sizes() && views.dim() == 1 && views.scalar_type() == torch::kInt64,
      "checkpoint: losses of ", losses.sizes(), " for views ", views.sizes());
  pending_.clear();
  ready_.clear();
  const auto view = views.accessor<std::int64_t, 1>();
  for (std::int64_t i = 0; i < views.size(0); ++i) {
    pending_.emplace_back(static_cast<std::size_t>(view[i]), losses[i].to(device));
  }
  newest_ = newest;
}

std::vector<std::pair<std::size_t, double>> DeferredLossReadback::take() {
  return std::exchange(ready_, {});
}

}  // namespace apvi::mapping
