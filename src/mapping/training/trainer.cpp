// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/training/trainer.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "apvi/core/log.hpp"
#include "core/random.hpp"
#include "core/stopwatch.hpp"
#include "gaussians/model/archive.hpp"
#include "mapping/appearance/illumination.hpp"
#include "mapping/density/random_insertion.hpp"
#include "mapping/density/seed_stream.hpp"
#include "mapping/training/retry_on_oom.hpp"
#include "medium/medium_initialization.hpp"

namespace apvi::mapping {
namespace {

constexpr double kGainStartProgress = 0.1;  // before, the map is too rough to estimate gains
constexpr double kMediumViewSpacing = 0.1;  // of the extent, between keyframes used for estimation
constexpr std::array<double, 4> kMediumEstimationProgress = {0.15, 0.3, 0.5, 0.7};

}  // namespace

Trainer::Trainer(KeyframeStore& keyframes, const gaussians::Gaussians& initial,
                 const TrainerOptions& options, const std::optional<medium::Medium>& medium)
    : keyframes_(keyframes),
      options_(options),
      extent_(scene_extent(keyframes)),
      initial_size_(initial.size()),
      estimates_medium_(medium && options.medium_estimation == MediumEstimationMethod::fit),
      optimizer_(initial, options_, keyframes.size(), medium) {
  TORCH_CHECK(!keyframes.training().empty(), "trainer: there are no training keyframes");
  TORCH_CHECK(initial.size() > 0, "trainer: the initial map is empty");
  keyframes_.set_tone_curve(optimizer_.tone_curve());
  if (resolves_moving_light(keyframes)) optimizer_.track_illumination(keyframes);
}

double Trainer::progress() const {
  const double by_count = static_cast<double>(iteration_) / std::max(1, options_.iterations);
  const double by_time = options_.time_budget_s > 0.0 ? seconds_ / options_.time_budget_s : 0.0;
  return std::min(1.0, std::max(by_count, by_time));
}

bool Trainer::done() const {
  if (options_.time_budget_s > 0.0 && seconds_ >= options_.time_budget_s) return true;
  return iteration_ >= options_.iterations + options_.final_iterations;
}

bool Trainer::reduce_memory() {
  if (!shrink_map(optimizer_)) return false;
  initial_size_ = std::min(initial_size_, most_gaussians());
  return true;
}

void Trainer::retry_on_oom(const std::function<void()>& work) {
  mapping::retry_on_oom(work, [this] { return reduce_memory(); });
}

// Every keyframe once per epoch, in a new random order each epoch.
std::size_t Trainer::choose_view() const {
  const auto& training = keyframes_.training();
  const auto count = static_cast<std::int64_t>(training.size());
  Random random(derive_seed(options_.seed, Stream::order, iteration_ / count));
  std::vector<std::size_t> order = training;
  for (std::size_t i = order.size() - 1; i > 0; --i) {
    std::swap(order[i], order[static_cast<std::size_t>(random.next() % (i + 1))]);
  }
  return order[static_cast<std::size_t>(iteration_ % count)];
}

// The reduction halves in equal intervals of the coarse phase.
int Trainer::reduction() const {
  const int levels = static_cast<int>(std::lround(std::log2(options_.initial_downscale)));
  if (levels == 0 || options_.full_resolution_after <= 0.0) return 1;
  const double phase = progress() / options_.full_resolution_after * levels;
  const int level = std::max(0, levels - static_cast<int>(phase));
  return 1 << level;
}

double Trainer::step() {
  const Stopwatch watch;
  const auto degree = static_cast<int>(iteration_ / options_.sh_degree_interval);
  const std::size_t view = choose_view();
  const StepSettings settings{.reduction = reduction(),
                              .sh_degree = std::min(options_.sh_degree, degree),
                              .correct_pose = progress() >= options_.pose_refinement.start_fraction,
                              .match_gain = progress() >= kGainStartProgress,
                              .rates = rates_at(options_.learning_rates, extent_, progress())};
  retry_on_oom([&] { losses_.add(view, optimizer_.step(keyframes_, view, settings)); });
  losses_.take();
  ++iteration_;
  maybe_densify();
  maybe_estimate_medium();
  seconds_ += watch.seconds();
  return losses_.newest();
}

// Repeated during training, because the estimate improves with the map.
void Trainer::maybe_estimate_medium() {
  if (!estimates_medium_ || medium_estimations_ >= kMediumEstimationProgress.size() ||
      progress() < kMediumEstimationProgress[medium_estimations_]) {
    return;
  }
  ++medium_estimations_;
  const torch::NoGradGuard no_grad;
  retry_on_oom([&] {
    const auto estimation = estimate_medium(full_map(), keyframes_, kMediumViewSpacing * extent_,
                                            medium::default_medium_prior(options_.lamps),
                                            derive_seed(options_.seed, Stream::medium, iteration_),
                                            {}, optimizer_.tone_curve_evidence());
    if (!estimation) return;
    optimizer_.apply_medium(*estimation, keyframes_);
    keyframes_.set_tone_curve(optimizer_.tone_curve());
  });
}

void Trainer::maybe_densify() {
  const DensifyOptions& d = options_.densify;
  if (d.kind == Densification::none || iteration_ % d.interval != 0) return;
  const double p = progress();
  if (p < d.start_fraction || p > d.end_fraction || iteration_ > options_.iterations) return;
  const double part = (p - d.start_fraction) / std::max(1e-9, d.end_fraction - d.start_fraction);
  if (d.kind != Densification::gradient) retry_on_oom([&] { insert_random(); });
  DensifyResult result;
  retry_on_oom([&] {
    const std::int64_t growth = std::max<std::int64_t>(0, most_gaussians() - initial_size_);
    const std::int64_t limit =
        initial_size_ + static_cast<std::int64_t>(part * static_cast<double>(growth));
    result = optimizer_.densify(extent_, limit,
                                derive_seed(options_.seed, Stream::split, iteration_), d.interval);
  });
  log::debug("iteration {}: {} cloned, {} split, {} pruned: {} Gaussians", iteration_,
             result.cloned, result.split, result.pruned, size());
}

void Trainer::insert_random() {
  const auto& training = keyframes_.training();
  Random random(derive_seed(options_.seed, Stream::insertion, iteration_));
  const std::size_t view = training[static_cast<std::size_t>(random.next() % training.size())];
  const std::int64_t count =
      std::min<std::int64_t>(options_.densify.random_per_round, optimizer_.room());
  if (count <= 0) return;
  optimizer_.insert(random_gaussians(full_map(), keyframes_, view, count, extent_, random));
}

void Trainer::save(const std::filesystem::path& checkpoint) const {
  torch::serialize::OutputArchive archive;
  optimizer_.save(archive);
  archive.write("iteration", torch::IValue(iteration_));
  archive.write("seconds", torch::IValue(seconds_));
  archive.write("medium_estimations",
                torch::IValue(static_cast<std::int64_t>(medium_estimations_)));
  archive.write("initial_size", torch::IValue(initial_size_));
  gaussians::write_archive(checkpoint, archive);
}

void Trainer::resume(const std::filesystem::path& checkpoint) {
  gaussians::read_archive(checkpoint, [this](torch::serialize::InputArchive& archive) {
    optimizer_.load(archive);
    keyframes_.set_tone_curve(optimizer_.tone_curve());
    iteration_ = gaussians::read_int(archive, "iteration");
    seconds_ = gaussians::read_double(archive, "seconds");
    medium_estimations_ =
        static_cast<std::size_t>(gaussians::read_int(archive, "medium_estimations"));
    initial_size_ = std::min(gaussians::read_int(archive, "initial_size"), most_gaussians());
  });
}

}  // namespace apvi::mapping
