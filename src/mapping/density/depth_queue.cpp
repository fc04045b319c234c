// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/depth_queue.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

namespace apvi::mapping {
namespace {

constexpr std::size_t kMaxSize = 8;  // while depth estimation is deferred

}  // namespace

DepthQueue::DepthQueue(const OnlineOptions& options)
    : every_(static_cast<std::size_t>(options.depth_every_keyframes)),
      lag_(static_cast<std::size_t>(options.depth_lag_keyframes)) {}

void DepthQueue::push(std::size_t view, std::size_t number) {
  if (number % every_ == 0) views_.push_back(view);
}

std::optional<std::size_t> DepthQueue::due() const {
  return views_.size() * every_ > lag_ ? std::optional(views_.front()) : std::nullopt;
}

void DepthQueue::thin() {
  if (views_.size() <= kMaxSize) return;
  std::deque<std::size_t> fewer;
  for (std::size_t k = 0; k < views_.size(); k += 2) fewer.push_back(views_[k]);
  views_ = std::move(fewer);
}

void DepthQueue::remove(std::size_t view) {
  views_.erase(std::remove(views_.begin(), views_.end(), view), views_.end());
}

void DepthQueue::save(torch::serialize::OutputArchive& archive) const {
  const std::vector<std::int64_t> views(views_.begin(), views_.end());
  archive.write("depth_queue", torch::tensor(views, torch::kInt64));
}

void DepthQueue::load(torch::serialize::InputArchive& archive) {
  torch::Tensor views;
  archive.read("depth_queue", views);
  const auto* const first = views.data_ptr<std::int64_t>();
  views_.assign(first, first + views.numel());
}

}  // namespace apvi::mapping
