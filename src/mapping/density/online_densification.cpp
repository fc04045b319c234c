// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/online_densification.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "apvi/core/log.hpp"
#include "gaussians/model/archive.hpp"
#include "mapping/density/seed_stream.hpp"
#include "mapping/training/retry_on_oom.hpp"

namespace apvi::mapping {

OnlineDensification::OnlineDensification(const MapperOptions& options)
    : options_(options.trainer.densify),
      budget_fraction_(options.online.densify_budget_fraction),
      max_interval_(options.online.max_densify_interval),
      seed_(options.trainer.seed) {}

void OnlineDensification::add_budget(std::int64_t room) {
  budget_ += budget_fraction_ * static_cast<double>(room);
}

// About the number of steps that two keyframes get, within bounds.
std::int64_t OnlineDensification::interval_steps(std::int64_t iteration, std::size_t views) const {
  const std::int64_t min_steps = options_.interval;
  const auto count = static_cast<std::int64_t>(std::max<std::size_t>(1, views));
  return std::max(min_steps, std::min(max_interval_, 2 * iteration / count));
}

bool OnlineDensification::is_due(std::int64_t iteration, std::size_t views) const {
  return options_.kind != Densification::none &&
         iteration - last_ >= interval_steps(iteration, views);
}

void OnlineDensification::run(std::int64_t iteration, double extent, MapOptimizer& optimizer,
                              KeyframeStore& keyframes) {
  const std::int64_t passed = iteration - last_;
  last_ = iteration;
  const std::int64_t before = optimizer.size();
  DensifyResult result;
  const auto round = [&] {
    const std::int64_t growth = std::min(static_cast<std::int64_t>(budget_), optimizer.room());
    result = optimizer.densify(extent, optimizer.size() + growth,
                               derive_seed(seed_, Stream::split, iteration), passed);
  };
  retry_on_oom(round, optimizer, keyframes);
  budget_ -= static_cast<double>(std::max<std::int64_t>(0, optimizer.size() - before));
  log::debug("iteration {}: {} cloned, {} split, {} pruned: {} Gaussians", iteration, result.cloned,
             result.split, result.pruned, optimizer.size());
}

void OnlineDensification::save(torch::serialize::OutputArchive& archive) const {
  archive.write("growth_budget", c10::IValue(budget_));
  archive.write("last_densify", c10::IValue(last_));
}

void OnlineDensification::load(torch::serialize::InputArchive& archive) {
  budget_ = gaussians::read_double(archive, "growth_budget");
  last_ = gaussians::read_int(archive, "last_densify");
}

}  // namespace apvi::mapping
