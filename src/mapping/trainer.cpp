// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/trainer.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "apvi/core/log.hpp"
#include "apvi/core/random.hpp"
#include "apvi/core/stopwatch.hpp"
#include "apvi/mapping/random_insertion.hpp"
#include "apvi/splat/medium_estimate.hpp"
#include "archive.hpp"
#include "memory_economy.hpp"
#include "seed_stream.hpp"

namespace apvi::mapping {
namespace {

constexpr double kGainsFrom = 0.1;      // part of the training before which the map is too rough
constexpr double kSurveySpacing = 0.1;  // of the extent, between keyframes that are compared
constexpr std::array<double, 4> kSurveys = {0.15, 0.3, 0.5, 0.7};  // parts of the training

}  // namespace

Trainer::Trainer(const KeyframeStore& keyframes, const splat::Gaussians& initial,
                 const TrainerOptions& options, const std::optional<splat::Medium>& medium)
    : keyframes_(keyframes),
      options_(options),
      extent_(scene_extent(keyframes)),
      initial_size_(initial.size()),
      learner_(initial, options, keyframes.size(), medium) {
  TORCH_CHECK(!keyframes.training().empty(), "trainer: there are no keyframes to learn from");
  TORCH_CHECK(initial.size() > 0, "trainer: the initial map is empty");
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

bool Trainer::economise() {
  if (!shrink(learner_, options_.densify.max_gaussians)) return false;
  initial_size_ = std::min(initial_size_, most_gaussians());
  return true;
}

void Trainer::within_memory(const std::function<void()>& work) {
  mapping::within_memory(work, [this] { return economise(); });
}

// Every keyframe once, in an order that is drawn anew each time round.
std::size_t Trainer::choose_view() const {
  const auto& training = keyframes_.training();
  const auto count = static_cast<std::int64_t>(training.size());
  Random random(seed_of(options_.seed, Stream::order, iteration_ / count));
  std::vector<std::size_t> order = training;
  for (std::size_t i = order.size() - 1; i > 0; --i) {
    std::swap(order[i], order[static_cast<std::size_t>(random.next() % (i + 1))]);
  }
  return order[static_cast<std::size_t>(iteration_ % count)];
}

// Halved again and again, each size for an equal part of the coarse phase.
int Trainer::reduction() const {
  const int levels = static_cast<int>(std::lround(std::log2(options_.coarsest)));
  if (levels == 0 || options_.coarse_until <= 0.0) return 1;
  const double phase = progress() / options_.coarse_until * levels;
  const int level = std::max(0, levels - static_cast<int>(phase));
  return 1 << level;
}

double Trainer::step() {
  const Stopwatch watch;
  const auto degree = static_cast<int>(iteration_ / options_.sh_interval);
  const std::size_t view = choose_view();
  const StepSettings settings{.reduction = reduction(),
                              .sh_degree = std::min(options_.sh_degree, degree),
                              .correct_pose = progress() >= options_.poses.begin,
                              .match_gain = progress() >= kGainsFrom,
                              .rates = rates_at(options_.rates, extent_, progress())};
  within_memory([&] { losses_.add(view, learner_.step(keyframes_, view, settings)); });
  losses_.take();
  ++iteration_;
  maybe_densify();
  maybe_survey_water();
  seconds_ += watch.seconds();
  return losses_.newest();
}

// A few times on the way: the better the map, the better it tells the water.
void Trainer::maybe_survey_water() {
  if (!medium() || surveys_ >= kSurveys.size() || progress() < kSurveys[surveys_]) return;
  ++surveys_;
  const torch::NoGradGuard no_grad;
  within_memory([&] {
    const auto survey =
        survey_water(whole_map(), keyframes_, kSurveySpacing * extent_, usual_prior(options_.lamp),
                     seed_of(options_.seed, Stream::survey, iteration_));
    if (survey) learner_.adopt(*survey, keyframes_);
  });
}

void Trainer::maybe_densify() {
  const DensifyOptions& d = options_.densify;
  if (d.kind == Densification::none || iteration_ % d.interval != 0) return;
  const double p = progress();
  if (p < d.begin || p > d.end || iteration_ > options_.iterations) return;
  const double part = (p - d.begin) / std::max(1e-9, d.end - d.begin);
  if (d.kind != Densification::gradient) within_memory([&] { insert_random(); });
  DensifyResult result;
  within_memory([&] {
    const std::int64_t growth = std::max<std::int64_t>(0, d.max_gaussians - initial_size_);
    const std::int64_t limit =
        initial_size_ + static_cast<std::int64_t>(part * static_cast<double>(growth));
    result = learner_.densify(extent_, limit, seed_of(options_.seed, Stream::split, iteration_),
                              d.interval);
  });
  log::debug("iteration {}: {} cloned, {} split, {} pruned: {} Gaussians", iteration_,
             result.cloned, result.split, result.pruned, size());
}

void Trainer::insert_random() {
  const auto& training = keyframes_.training();
  Random random(seed_of(options_.seed, Stream::insertion, iteration_));
  const std::size_t view = training[static_cast<std::size_t>(random.next() % training.size())];
  const std::int64_t room = options_.densify.max_gaussians - size();
  const std::int64_t count = std::min<std::int64_t>(options_.densify.random_per_round, room);
  if (count <= 0) return;
  learner_.insert(random_gaussians(whole_map(), keyframes_, view, count, extent_, random));
}

void Trainer::save(const std::filesystem::path& checkpoint) const {
  torch::serialize::OutputArchive archive;
  learner_.save(archive);
  archive.write("iteration", torch::IValue(iteration_));
  archive.write("seconds", torch::IValue(seconds_));
  archive.write("surveys", torch::IValue(static_cast<std::int64_t>(surveys_)));
  archive.write("initial_size", torch::IValue(initial_size_));
  write_archive(checkpoint, archive);
}

void Trainer::resume(const std::filesystem::path& checkpoint) {
  read_archive(checkpoint, [this](torch::serialize::InputArchive& archive) {
    learner_.load(archive);
    iteration_ = read_int(archive, "iteration");
    seconds_ = read_double(archive, "seconds");
    surveys_ = static_cast<std::size_t>(read_int(archive, "surveys"));
    initial_size_ = std::min(read_int(archive, "initial_size"), most_gaussians());
  });
}

}  // namespace apvi::mapping
