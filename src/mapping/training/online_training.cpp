// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/training/online_training.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "core/random.hpp"
#include "gaussians/device.hpp"
#include "gaussians/model/archive.hpp"
#include "mapping/density/seed_stream.hpp"
#include "mapping/training/retry_on_oom.hpp"

namespace apvi::mapping {

OnlineTraining::OnlineTraining(const MapperOptions& options)
    : trainer_(options.trainer),
      online_(options.online),
      schedule_(static_cast<std::size_t>(options.online.recent_keyframes),
                options.online.recent_fraction) {}

// New keyframes start at low resolution.
int OnlineTraining::reduction(std::size_t view) const {
  const int levels = static_cast<int>(std::lround(std::log2(trainer_.initial_downscale)));
  if (final_start_ || online_.uses_per_pyramid_level <= 0) return 1;
  const auto passed = static_cast<int>(schedule_.uses(view) / online_.uses_per_pyramid_level);
  return 1 << std::max(0, levels - passed);
}

LearningRates OnlineTraining::rates() const {
  const double early = std::exp(-static_cast<double>(iteration_) / online_.rate_decay_steps);
  return trainer_.learning_rates.times(online_.final_rate_factor +
                                       (1.0 - online_.final_rate_factor) * early);
}

StepSettings OnlineTraining::settings(std::size_t view, double extent) const {
  const auto degree = static_cast<int>(iteration_ / trainer_.sh_degree_interval);
  return {.reduction = reduction(view),
          .sh_degree = std::min(trainer_.sh_degree, degree),
          .correct_pose = final_start_ && progress() >= trainer_.pose_refinement.start_fraction,
          .rates = rates_at(rates(), extent, progress())};
}

void OnlineTraining::step(double extent, MapOptimizer& optimizer, KeyframeStore& keyframes) {
  Random random(derive_seed(trainer_.seed, Stream::order, iteration_));
  const std::size_t view = schedule_.draw(random);
  const StepSettings now = settings(view, extent);
  retry_on_oom([&] { losses_.add(view, optimizer.step(keyframes, view, now)); }, optimizer,
               keyframes);
  schedule_.use(view);
  for (const auto& [i, value] : losses_.take()) schedule_.report(i, value);
  ++iteration_;
}

void OnlineTraining::begin_final() {
  schedule_.disable_recency_bias();
  final_start_ = iteration_;
}

void OnlineTraining::add_final_time(double seconds) {
  if (final_start_) final_seconds_ += seconds;
}

double OnlineTraining::progress() const {
  if (!final_start_) return 0.0;
  const double by_count = static_cast<double>(iteration_ - *final_start_) /
                          std::max(1, trainer_.final_iterations.value_or(0));
  const double budget = trainer_.time_budget_s;
  return std::min(1.0, std::max(by_count, budget > 0.0 ? final_seconds_ / budget : 0.0));
}

bool OnlineTraining::final_done() const {
  return final_start_ && (trainer_.final_iterations.value_or(0) == 0 || progress() >= 1.0);
}

void OnlineTraining::save(torch::serialize::OutputArchive& archive) const {
  torch::serialize::OutputArchive schedule;
  schedule_.save(schedule);
  archive.write("schedule", schedule);
  torch::serialize::OutputArchive losses;
  losses_.save(losses);
  archive.write("losses", losses);
  archive.write("iteration", c10::IValue(iteration_));
}

void OnlineTraining::load(torch::serialize::InputArchive& archive) {
  torch::serialize::InputArchive part;
  archive.read("schedule", part);
  schedule_.load(part);
  archive.read("losses", part);
  losses_.load(part, gaussians::active_device());
  iteration_ = gaussians::read_int(archive, "iteration");
}

}  // namespace apvi::mapping
