// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/mapper.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "apvi/core/angles.hpp"
#include "apvi/core/log.hpp"
#include "apvi/core/random.hpp"
#include "apvi/core/stopwatch.hpp"
#include "apvi/mapping/picture_content.hpp"
#include "apvi/mapping/water_survey.hpp"
#include "apvi/splat/medium_estimate.hpp"
#include "memory_economy.hpp"
#include "seed_stream.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::size_t kMostWaiting = 8;  // for depth, in a hurry

// Silt comes and goes within a second or two; a picture half veiled by it has contrast enough not
// to be murky, and teaches the map a fog all the same.
constexpr std::int64_t kClearing_ns = 700'000'000;
constexpr std::size_t kFewestKeyframes = 2;  // that are left to learn from
constexpr std::int64_t kOutage_ns = 2'000'000'000;
constexpr double kSurveySpacing = 0.1;  // of the extent, between keyframes that are compared
constexpr double kAlike = 1e3;          // a patch sigma that leaves no pixel out

/// Lamplit pictures are noisy: which views fit best and which pixels look like their middle is then
/// a matter of chance, and choosing costs new Gaussians more than what is seen behind edges brings.
/// Surveys of the water choose: they only look where the map has a surface, and average its slope.
DepthOptions by_lamplight(DepthOptions depth) {
  depth.best_share = 1.0;
  depth.patch_sigma = kAlike;
  return depth;
}

splat::Gaussians clone(const splat::Gaussians& gaussians) {
  splat::Gaussians copy;
  for (std::size_t k = 0; k < copy.tensors().size(); ++k) {
    *copy.tensors()[k] = gaussians.tensors()[k]->clone();
  }
  return copy;
}

}  // namespace

std::string_view to_string(Intake intake) {
  switch (intake) {
    case Intake::taken:
      return "taken";
    case Intake::held_out:
      return "held_out";
    case Intake::no_picture:
      return "no_picture";
    case Intake::duplicate:
      return "duplicate";
    case Intake::bad_pose:
      return "bad_pose";
    case Intake::bad_picture:
      return "bad_picture";
    case Intake::black:
      return "black";
    case Intake::murky:
      return "murky";
  }
  return "unknown";
}

Mapper::Mapper(const MapperOptions& options)
    : options_(options),
      insertion_depth_(options.trainer.lamp ? by_lamplight(options.depth) : options.depth),
      drift_({.translation_m = options.online.drift_m,
              .rotation_rad = kRadians * options.online.drift_deg}),
      first_sight_(options.trainer.densify.max_gaussians),
      schedule_(static_cast<std::size_t>(options.online.recent_keyframes),
                options.online.recent_share),
      surveys_(static_cast<std::size_t>(std::max(1, options.online.medium_after))),
      points_(torch::empty({0, 3}, torch::kFloat64)) {
  options_.trainer.sparse_adam = options.trainer.sparse_adam || options.online.sparse_adam;
}

Intake Mapper::judge(const MapperInput& input) const {
  const Keyframe& keyframe = input.keyframe;
  const Tensor& image = keyframe.image;
  if (!image.defined()) return Intake::no_picture;
  if (!is_rigid(keyframe.T_camera_world)) return Intake::bad_pose;
  if (image.scalar_type() != torch::kUInt8 || image.numel() == 0 ||
      image.sizes() !=
          at::IntArrayRef({keyframe.intrinsics.height, keyframe.intrinsics.width, 3})) {
    return Intake::bad_picture;
  }
  if (by_stamp_.count(keyframe.stamp_ns) > 0) return Intake::duplicate;
  if (is_black(image)) return Intake::black;
  if (input.murky || keyframe.stamp_ns < clears_ns_) return Intake::murky;
  return keyframe.held_out ? Intake::held_out : Intake::taken;
}

Intake Mapper::add(const MapperInput& input) {
  const torch::NoGradGuard no_grad;
  {
    const auto entry = times_.enter("poses");
    move(input.moved);
    relocate(input.relocated);
  }
  vio_failing_ = input.vio_failing;
  if (learner_) learner_->set_vio_failing(vio_failing_);
  if (input.murky) {
    if (input.keyframe.stamp_ns >= clears_ns_) forget_veiled(input.keyframe.stamp_ns);
    clears_ns_ = input.keyframe.stamp_ns + kClearing_ns;
  }
  const Intake intake = judge(input);
  ++counts_[intake];
  if (intake == Intake::held_out) {
    keep(input.keyframe);
    const auto leader = input.follows_ns ? by_stamp_.find(*input.follows_ns) : by_stamp_.end();
    if (leader != by_stamp_.end()) followers_[leader->second].push_back(keyframes_.size() - 1);
    thin_held_out();
  }
  if (intake != Intake::taken) return intake;
  note_outage(input.keyframe.stamp_ns);
  keep(input.keyframe);
  const std::size_t view = keyframes_.size() - 1;
  schedule_.add(view);
  if (learner_) {
    const auto entry = times_.enter("gains");
    within_memory([&] { learner_->match_gain(keyframes_, view); });
  }
  within_memory([&] { align(view); });
  growth_ += options_.online.growth_share * static_cast<double>(room());
  insert_points(view, input);
  if (options_.trainer.densify.kind == Densification::random) {
    within_memory([&] { insert_random(view); });
  }
  if (options_.trainer.densify.kind == Densification::quadtree) want_depth(view, input.hurry);
  make_memory();
  maybe_survey_water(input);
  return intake;
}

// In a hurry every second one that waits goes: what is left is spread over the way.
void Mapper::want_depth(std::size_t view, bool hurry) {
  const auto every = static_cast<std::size_t>(options_.online.depth_every);
  if (counts_[Intake::taken] % every == 0) waiting_.push_back(view);
  if (waiting_.size() * every <= static_cast<std::size_t>(options_.online.depth_lag)) return;
  if (!hurry) {
    within_memory([&] { fill_from_depth(waiting_.front()); });
    return waiting_.pop_front();
  }
  if (waiting_.size() <= kMostWaiting) return;
  std::deque<std::size_t> fewer;
  for (std::size_t k = 0; k < waiting_.size(); k += 2) fewer.push_back(waiting_[k]);
  waiting_ = std::move(fewer);
}

void Mapper::fill_waiting() {
  const torch::NoGradGuard no_grad;
  for (const std::size_t view : waiting_) {
    within_memory([&] { fill_from_depth(view); });
  }
  waiting_.clear();
}

void Mapper::keep(const Keyframe& keyframe) {
  const std::size_t next = keyframes_.size();
  keyframes_.add(keyframe);
  drift_.add();
  keyframes_.set_pose(next, drift_.in_map(next, keyframe.T_camera_world));
  by_stamp_[keyframe.stamp_ns] = next;
  if (learner_) {
    within_memory([&] { learner_->add_view(); });
  }
}

// Sight has gone: it was going already.
void Mapper::forget_veiled(std::int64_t stamp_ns) {
  const auto veiled = by_stamp_.lower_bound(stamp_ns - kClearing_ns);
  for (auto it = veiled; it != by_stamp_.end(); ++it) {
    const std::size_t view = it->second;
    if (!keyframes_[view].image.defined()) continue;
    const bool held_out = keyframes_[view].held_out;
    if (!held_out && keyframes_.training().size() <= kFewestKeyframes) continue;
    --counts_[held_out ? Intake::held_out : Intake::taken];
    ++counts_[Intake::murky];
    keyframes_.drop_image(view);
    if (!held_out) schedule_.remove(view);
    waiting_.erase(std::remove(waiting_.begin(), waiting_.end(), view), waiting_.end());
  }
}

// Of the older keyframes goes the one whose neighbours in time stand closest together.
void Mapper::make_memory() {
  const double most = options_.online.memory_mib * 1024.0 * 1024.0;
  const auto recent = static_cast<std::size_t>(std::max(2, options_.online.recent_keyframes));
  while (static_cast<double>(keyframes_.image_bytes()) > most) {
    const std::vector<std::size_t>& views = keyframes_.training();
    if (views.size() <= recent + 2) return;
    std::size_t redundant = views[1];
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 1; k + recent < views.size(); ++k) {
      const Tensor before = camera_center(keyframes_[views[k - 1]].T_camera_world);
      const Tensor after = camera_center(keyframes_[views[k + 1]].T_camera_world);
      const double gap = (after - before).norm().item<double>();
      if (gap >= least) continue;
      least = gap;
      redundant = views[k];
    }
    keyframes_.drop_image(redundant);
    schedule_.remove(redundant);
  }
}

// Every second one goes when there are too many, and from then on only every second is kept.
// Counted by what the recording has, so that the same are kept whichever were lost on the way, and
// a simulator can know which need its truth.
void Mapper::thin_held_out() {
  const auto is_left_out = [this](std::size_t i) {
    return keyframes_[i].number % heldout_stride_ != 0;
  };
  const std::size_t newest = keyframes_.size() - 1;
  if (is_left_out(newest)) return keyframes_.drop_image(newest);
  const auto most = static_cast<std::size_t>(std::max(1, options_.online.heldout_views));
  if (keyframes_.held_out().size() <= most) return;
  heldout_stride_ *= 2;
  const std::vector<std::size_t> all = keyframes_.held_out();
  for (const std::size_t i : all) {
    if (is_left_out(i)) keyframes_.drop_image(i);
  }
}

void Mapper::note_outage(std::int64_t stamp_ns) {
  const std::vector<std::size_t>& views = keyframes_.training();
  if (views.empty() || stamp_ns - keyframes_[views.back()].stamp_ns < kOutage_ns) return;
  surveys_.sight_returned(counts_[Intake::taken]);
}

// All but the first can wait while there is too much else to do.
void Mapper::maybe_survey_water(const MapperInput& input) {
  if (!options_.medium || !learner_ || size() == 0) return;
  if (learner_->medium() && (input.hurry || input.crowded)) return;
  const std::size_t taken = counts_[Intake::taken];
  if (!surveys_.is_due(taken)) return;
  surveys_.surveyed(taken);
  within_memory([&] { survey_water(); });
}

void Mapper::survey_water() {
  const torch::NoGradGuard no_grad;
  const auto entry = times_.enter("water");
  const Map map = learner_->whole_map();
  const WaterPrior prior = usual_prior(options_.trainer.lamp, learner_->surveys());
  const auto survey = mapping::survey_water(
      map, keyframes_, kSurveySpacing * extent_, prior,
      seed_of(options_.trainer.seed, Stream::survey, iteration_), options_.depth);
  if (survey) {
    log::debug("water surveyed after {} keyframes, from {} of them{}, to {:.0f} %",
               keyframes_.training().size(), survey->views.size(),
               survey->sees_open_water ? " and open water" : "",
               100.0 * survey->fit.sigmas.mean().item<double>());
    learner_->adopt(*survey, keyframes_);
    schedule_.pardon();
  } else if (!learner_->medium()) {
    learner_->adopt(splat::coastal_medium(), torch::zeros({3, 3, 3}, torch::kFloat64), keyframes_);
  }
  learner_->set_vio_failing(vio_failing_);
}

// Small pictures first, as long as a keyframe is new.
int Mapper::reduction(std::size_t view) const {
  const int levels = static_cast<int>(std::lround(std::log2(options_.trainer.coarsest)));
  if (final_start_ || options_.online.pyramid_uses <= 0) return 1;
  const auto passed = static_cast<int>(schedule_.uses(view) / options_.online.pyramid_uses);
  return 1 << std::max(0, levels - passed);
}

LearningRates Mapper::rates() const {
  const OnlineOptions& online = options_.online;
  const double early = std::exp(-static_cast<double>(iteration_) / online.late_rates_steps);
  return options_.trainer.rates.times(online.late_rates + (1.0 - online.late_rates) * early);
}

double Mapper::step() {
  TORCH_CHECK(ready(), "mapper: there is nothing to learn yet");
  const Stopwatch watch;
  const auto entry = times_.enter("steps");
  Random random(seed_of(options_.trainer.seed, Stream::order, iteration_));
  const std::size_t view = schedule_.draw(random);
  const auto degree = static_cast<int>(iteration_ / options_.trainer.sh_interval);
  const bool correct = final_start_ && progress() >= options_.trainer.poses.begin;
  const StepSettings settings = {.reduction = reduction(view),
                                 .sh_degree = std::min(options_.trainer.sh_degree, degree),
                                 .correct_pose = correct,
                                 .rates = rates_at(rates(), extent_, progress())};
  within_memory([&] { losses_.add(view, learner_->step(keyframes_, view, settings)); });
  schedule_.use(view);
  for (const auto& [seen, loss] : losses_.take()) schedule_.report(seen, loss);
  ++iteration_;
  maybe_densify();
  if (final_start_) final_seconds_ += watch.seconds();
  return losses_.newest();
}

// Two keyframes' steps, within bounds.
std::int64_t Mapper::round_length() const {
  const std::int64_t shortest = options_.trainer.densify.interval;
  const std::int64_t longest = options_.online.densify_interval;
  const auto views = static_cast<std::int64_t>(std::max<std::size_t>(1, schedule_.size()));
  return std::max(shortest, std::min(longest, 2 * iteration_ / views));
}

void Mapper::maybe_densify() {
  const std::int64_t passed = iteration_ - last_round_;
  if (final_start_ || options_.trainer.densify.kind == Densification::none) return;
  if (passed < round_length()) return;
  last_round_ = iteration_;
  const auto entry = times_.enter("growth");
  const std::int64_t before = size();
  DensifyResult result;
  within_memory([&] {
    const std::int64_t most = size() + std::min(static_cast<std::int64_t>(growth_), room());
    result = learner_->densify(extent_, most,
                               seed_of(options_.trainer.seed, Stream::split, iteration_), passed);
  });
  growth_ -= static_cast<double>(std::max<std::int64_t>(0, size() - before));
  log::debug("iteration {}: {} cloned, {} split, {} pruned: {} Gaussians", iteration_,
             result.cloned, result.split, result.pruned, size());
}

void Mapper::begin_final() {
  if (final_start_) return;
  const torch::NoGradGuard no_grad;
  // New Gaussians, and a survey, which changes colours, gains and water at once, take steps to
  // settle.
  if (options_.trainer.final_iterations > 0) {
    fill_waiting();
    if (options_.medium && learner_ && size() > 0) {
      within_memory([&] { survey_water(); });
    }
  }
  schedule_.forget_recency();
  final_start_ = iteration_;
}

bool Mapper::final_done() const {
  return final_start_ && (!ready() || options_.trainer.final_iterations == 0 || progress() >= 1.0);
}

double Mapper::progress() const {
  if (!final_start_) return 0.0;
  const double by_count = static_cast<double>(iteration_ - *final_start_) /
                          std::max(1, options_.trainer.final_iterations);
  const double budget = options_.trainer.time_budget_s;
  return std::min(1.0, std::max(by_count, budget > 0.0 ? final_seconds_ / budget : 0.0));
}

// First what costs time only.
bool Mapper::economise() {
  if (size() < kFewestToShrink) return false;
  if (keyframes_.device().is_cpu()) {
    return shrink(*learner_, options_.trainer.densify.max_gaussians);
  }
  log::warning("no memory left on the device: pictures are kept on the host from now on");
  keyframes_.move_images(torch::kCPU);
  return true;
}

void Mapper::within_memory(const std::function<void()>& work) {
  mapping::within_memory(work, [this] { return economise(); });
}

Map Mapper::map() const {
  if (learner_) return learner_->whole_map();
  return {.gaussians = splat::Gaussians::empty(options_.trainer.sh_degree, torch::kFloat32),
          .medium = std::nullopt,
          .antialiased = options_.trainer.antialiased};
}

Map Mapper::snapshot() const {
  Map map = this->map();
  map.gaussians = clone(map.gaussians);
  if (map.log_gains.defined()) map.log_gains = map.log_gains.clone();
  return map;
}

Tensor Mapper::pose(std::size_t i) const {
  const Tensor& given = keyframes_[i].T_camera_world;
  return learner_ ? corrected_pose(given, learner_->corrections().pose_delta(i, false)) : given;
}

}  // namespace apvi::mapping
