// SPDX-License-Identifier: BSD-3-Clause
#include "runs/live/map_copier.hpp"

#include <torch/torch.h>

#include <chrono>
#include <exception>
#include <utility>

#include "apvi/core/log.hpp"

namespace apvi::runs {
namespace {

constexpr std::chrono::milliseconds kPeriod(500);

}  // namespace

MapCopier::MapCopier() : thread_([this](const std::stop_token& stop) { run(stop); }) {}

void MapCopier::set_mapper(slam::AsyncMapper* mapper) {
  const std::scoped_lock lock(mapper_mutex_);
  mapper_ = mapper;
}

std::optional<MapCopier::Copy> MapCopier::take() {
  const std::scoped_lock lock(mutex_);
  std::optional<Copy> out = std::exchange(newest_, std::nullopt);
  if (out) taken_.notify_all();
  return out;
}

std::optional<MapCopier::Copy> MapCopier::copy() {
  const std::scoped_lock lock(mapper_mutex_);
  if (mapper_ == nullptr || mapper_->gaussian_count() == 0) return std::nullopt;
  Copy out{.map = mapper_->preview(), .extent = {}};
  if (out.map.iteration == iteration_ || out.map.map.gaussians.size() == 0) return std::nullopt;
  iteration_ = out.map.iteration;
  out.extent = extent_of(out.map.map);
  return out;
}

void MapCopier::run(const std::stop_token& stop) {
  torch::set_num_threads(1);  // of this thread: the others are for the run
  while (!stop.stop_requested()) {
    try {
      if (auto next = copy()) {
        const std::scoped_lock lock(mutex_);
        newest_ = std::move(next);
      }
    } catch (const std::exception& error) {  // such as no memory
      log::warning("viewer: the map was not copied: {}", error.what());
    }
    std::unique_lock lock(mutex_);
    taken_.wait_for(lock, stop, kPeriod, [] { return false; });
    taken_.wait(lock, stop, [this] { return !newest_; });
  }
}

}  // namespace apvi::runs
