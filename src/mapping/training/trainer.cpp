// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/training/trainer.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <string>
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

std::string session_key(std::size_t i) {
  return "session" + std::to_string(i);
}

double extent_of(const std::vector<TrainingSession>& sessions) {
  std::vector<const KeyframeStore*> stores;
  for (const TrainingSession& session : sessions) stores.push_back(session.keyframes);
  return scene_extent(stores);
}

}  // namespace

Trainer::Trainer(KeyframeStore& keyframes, const gaussians::Gaussians& initial,
                 const TrainerOptions& options, const std::optional<medium::Medium>& medium)
    : Trainer({{.keyframes = &keyframes, .options = options, .medium = medium}}, initial) {}

Trainer::Trainer(const std::vector<TrainingSession>& sessions, const gaussians::Gaussians& initial)
    : options_(sessions.at(0).options),
      extent_(extent_of(sessions)),
      initial_size_(initial.size()) {
  TORCH_CHECK(initial.size() > 0, "trainer: the initial map is empty");
  sessions_.reserve(sessions.size());
  for (const TrainingSession& s : sessions) {
    if (sessions_.empty()) {
      add(s, MapOptimizer(initial, s.options, s.keyframes->size(), s.medium));
    } else {
      add(s, optimizer().session(s.options, s.keyframes->size(), s.medium, s.light));
    }
  }
  TORCH_CHECK(!views_.empty(), "trainer: there are no training keyframes");
}

void Trainer::add(const TrainingSession& session, MapOptimizer optimizer) {
  KeyframeStore& keyframes = *session.keyframes;
  const TrainerOptions& options = session.options;
  for (const std::size_t i : keyframes.training()) views_.push_back({sessions_.size(), i});
  keyframes.set_tone_curve(optimizer.tone_curve());
  if (resolves_moving_light(keyframes)) optimizer.track_illumination(keyframes);
  if (options.refine) {
    optimizer.hold_medium();
    if (session.response) optimizer.start_from(*session.response);
    if (!session.response || !session.response->log_gains.defined()) {
      for (const std::size_t i : keyframes.training()) optimizer.measure_gain(keyframes, i);
    }
  }
  const bool estimates = session.medium && options.medium_estimation == MediumEstimationMethod::fit;
  if (options.refine && session.medium && !estimates)
    optimizer.hold_median_gain(keyframes.training());
  sessions_.push_back({&keyframes, options, estimates, std::move(optimizer)});
}

double Trainer::progress() const {
  const double by_count = static_cast<double>(iteration_) / std::max(1, options_.iterations);
  const double by_time = options_.time_budget_s > 0.0 ? seconds_ / options_.time_budget_s : 0.0;
  const double part = std::min(1.0, std::max(by_count, by_time));
  return options_.schedule_start + part * (options_.schedule_end - options_.schedule_start);
}

bool Trainer::done() const {
  if (options_.time_budget_s > 0.0 && seconds_ >= options_.time_budget_s) return true;
  return iteration_ >= options_.iterations + options_.final_iterations.value_or(0);
}

bool Trainer::reduce_memory() {
  if (!shrink_map(optimizer())) return false;
  initial_size_ = std::min(initial_size_, max_gaussians());
  return true;
}

void Trainer::retry_on_oom(const std::function<void()>& work) {
  mapping::retry_on_oom(work, [this] { return reduce_memory(); });
}

// Every training image once per epoch, in a new random order each epoch.
std::size_t Trainer::choose_view() const {
  const auto count = static_cast<std::int64_t>(views_.size());
  Random random(derive_seed(options_.seed, Stream::order, iteration_ / count));
  std::vector<std::size_t> order(views_.size());
  std::iota(order.begin(), order.end(), 0);
  for (std::size_t i = order.size() - 1; i > 0; --i) {
    std::swap(order[i], order[static_cast<std::size_t>(random.next() % (i + 1))]);
  }
  return order[static_cast<std::size_t>(iteration_ % count)];
}

// The reduction halves in equal intervals of the coarse phase.
int Trainer::reduction() const {
  if (options_.refine) return 1;
  const int levels = static_cast<int>(std::lround(std::log2(options_.initial_downscale)));
  if (levels == 0 || options_.full_resolution_after <= 0.0) return 1;
  const double phase = progress() / options_.full_resolution_after * levels;
  const int level = std::max(0, levels - static_cast<int>(phase));
  return 1 << level;
}

double Trainer::step() {
  const Stopwatch watch;
  const auto degree = static_cast<int>(iteration_ / options_.sh_degree_interval);
  const std::size_t chosen = choose_view();
  const TrainingView& view = views_[chosen];
  Session& session = sessions_[view.session];
  const StepSettings settings{
      .reduction = reduction(),
      .sh_degree = options_.refine ? options_.sh_degree : std::min(options_.sh_degree, degree),
      .correct_pose = progress() >= options_.pose_refinement.start_fraction,
      .match_gain = options_.refine || progress() >= kGainStartProgress,
      .rates = rates_at(options_.learning_rates, extent_, progress())};
  retry_on_oom([&] {
    losses_.add(chosen, session.optimizer.step(*session.keyframes, view.keyframe, settings));
  });
  losses_.take();
  ++iteration_;
  maybe_densify();
  maybe_estimate_medium();
  seconds_ += watch.seconds();
  return losses_.newest();
}

// Repeated during training, because the estimate improves with the map.
void Trainer::maybe_estimate_medium() {
  if (medium_estimations_ >= kMediumEstimationProgress.size() ||
      progress() < kMediumEstimationProgress[medium_estimations_]) {
    return;
  }
  ++medium_estimations_;
  for (Session& session : sessions_) {
    if (session.estimates_medium) estimate_medium_of(session);
  }
}

void Trainer::estimate_medium_of(Session& session) {
  const torch::NoGradGuard no_grad;
  MapOptimizer& optimizer = session.optimizer;
  const TrainerOptions& options = session.options;
  retry_on_oom([&] {
    const auto estimation = estimate_medium(
        optimizer.full_map(), *session.keyframes, kMediumViewSpacing * extent_,
        medium::default_medium_prior(options.lamps),
        derive_seed(options.seed, Stream::medium, iteration_), {}, optimizer.tone_curve_evidence());
    if (!estimation) return;
    optimizer.apply_medium(*estimation, *session.keyframes);
    session.keyframes->set_tone_curve(optimizer.tone_curve());
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
    const std::int64_t growth = std::max<std::int64_t>(0, max_gaussians() - initial_size_);
    const std::int64_t limit =
        initial_size_ + static_cast<std::int64_t>(part * static_cast<double>(growth));
    result = optimizer().densify(extent_, limit,
                                 derive_seed(options_.seed, Stream::split, iteration_), d.interval);
  });
  log::debug("iteration {}: {} cloned, {} split, {} pruned: {} Gaussians", iteration_,
             result.cloned, result.split, result.pruned, size());
}

void Trainer::insert_random() {
  Random random(derive_seed(options_.seed, Stream::insertion, iteration_));
  const TrainingView& view = views_[static_cast<std::size_t>(random.next() % views_.size())];
  const Session& session = sessions_[view.session];
  const std::int64_t count =
      std::min<std::int64_t>(options_.densify.random_per_round, optimizer().room());
  if (count <= 0) return;
  optimizer().insert(random_gaussians(session.optimizer.full_map(), *session.keyframes,
                                      view.keyframe, count, extent_, random));
}

void Trainer::save(const std::filesystem::path& checkpoint) const {
  torch::serialize::OutputArchive archive;
  optimizer().save(archive);
  for (std::size_t i = 1; i < sessions_.size(); ++i) {
    torch::serialize::OutputArchive session;
    sessions_[i].optimizer.save_session(session);
    archive.write(session_key(i), session);
  }
  archive.write("iteration", torch::IValue(iteration_));
  archive.write("seconds", torch::IValue(seconds_));
  archive.write("medium_estimations",
                torch::IValue(static_cast<std::int64_t>(medium_estimations_)));
  archive.write("initial_size", torch::IValue(initial_size_));
  gaussians::write_archive(checkpoint, archive);
}

void Trainer::resume(const std::filesystem::path& checkpoint) {
  gaussians::read_archive(checkpoint, [this](torch::serialize::InputArchive& archive) {
    optimizer().load(archive);
    for (std::size_t i = 1; i < sessions_.size(); ++i) {
      torch::serialize::InputArchive session;
      archive.read(session_key(i), session);
      sessions_[i].optimizer.load_session(session);
    }
    for (Session& s : sessions_) s.keyframes->set_tone_curve(s.optimizer.tone_curve());
    iteration_ = gaussians::read_int(archive, "iteration");
    seconds_ = gaussians::read_double(archive, "seconds");
    medium_estimations_ =
        static_cast<std::size_t>(gaussians::read_int(archive, "medium_estimations"));
    initial_size_ = std::min(gaussians::read_int(archive, "initial_size"), max_gaussians());
  });
}

}  // namespace apvi::mapping
