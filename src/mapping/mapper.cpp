// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/mapper.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "apvi/core/constants.hpp"
#include "apvi/core/log.hpp"
#include "core/random.hpp"
#include "core/stopwatch.hpp"
#include "mapping/density/gaussian_limit.hpp"
#include "mapping/density/seed_stream.hpp"
#include "mapping/keyframes/image_visibility.hpp"
#include "mapping/medium/initial_medium.hpp"
#include "mapping/medium/medium_estimation.hpp"
#include "mapping/training/retry_on_oom.hpp"
#include "medium/medium_initialization.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::size_t kMaxDepthQueue = 8;  // while depth estimation is deferred

// Silt clouds last a second or two. Images at their edges pass the visibility check but would still
// leave semi-transparent Gaussians in the map.
constexpr std::int64_t kLowVisibilityMargin_ns = 700'000'000;
constexpr std::size_t kMinTrainingKeyframes = 2;  // that are always kept
constexpr std::int64_t kOutage_ns = 2'000'000'000;
constexpr double kMediumViewSpacing = 0.1;  // of the extent, between keyframes used for estimation
constexpr double kUniformPatchSigma = 1e3;  // disables the patch's color weights

/// Lamp-lit images are noisy, so selecting the best views and weighting patch pixels by color picks
/// noise and costs more Gaussians than it gains behind edges. Medium estimation keeps the
/// selection: it only uses mapped surfaces and averages their normals.
depth::DepthOptions depth_options_with_lamp(depth::DepthOptions depth) {
  depth.best_views_fraction = 1.0;
  depth.patch_intensity_sigma = kUniformPatchSigma;
  return depth;
}

gaussians::Gaussians clone(const gaussians::Gaussians& gaussians) {
  gaussians::Gaussians copy;
  for (std::size_t k = 0; k < copy.tensors().size(); ++k) {
    *copy.tensors()[k] = gaussians.tensors()[k]->clone();
  }
  return copy;
}

}  // namespace

std::string_view to_string(KeyframeDecision decision) {
  switch (decision) {
    case KeyframeDecision::accepted:
      return "accepted";
    case KeyframeDecision::held_out:
      return "held_out";
    case KeyframeDecision::no_image:
      return "no_image";
    case KeyframeDecision::duplicate:
      return "duplicate";
    case KeyframeDecision::bad_pose:
      return "bad_pose";
    case KeyframeDecision::bad_image:
      return "bad_image";
    case KeyframeDecision::black:
      return "black";
    case KeyframeDecision::low_visibility:
      return "low_visibility";
  }
  return "unknown";
}

Mapper::Mapper(const MapperOptions& options)
    : options_(options),
      insertion_depth_(options.trainer.lamp ? depth_options_with_lamp(options.depth)
                                            : options.depth),
      map_odom_({.translation_m = options.online.drift_m_s,
                 .rotation_rad = kRadiansPerDegree * options.online.drift_deg_s}),
      reference_map_(gaussian_limit(options.trainer.densify)),
      schedule_(static_cast<std::size_t>(options.online.recent_keyframes),
                options.online.recent_fraction),
      medium_schedule_(static_cast<std::size_t>(std::max(1, options.online.medium_min_keyframes))),
      points_(torch::empty({0, 3}, torch::kFloat64)) {
  options_.trainer.densify.max_gaussians = gaussian_limit(options.trainer.densify);
  options_.trainer.sparse_adam = options.trainer.sparse_adam || options.online.sparse_adam;
}

KeyframeDecision Mapper::validate(const MapperInput& input) const {
  const Keyframe& keyframe = input.keyframe;
  const Tensor& image = keyframe.image;
  if (!image.defined()) return KeyframeDecision::no_image;
  if (!is_rigid(keyframe.T_camera_world)) return KeyframeDecision::bad_pose;
  if (image.scalar_type() != torch::kUInt8 || image.numel() == 0 ||
      image.sizes() !=
          at::IntArrayRef({keyframe.intrinsics.height, keyframe.intrinsics.width, 3})) {
    return KeyframeDecision::bad_image;
  }
  if (by_stamp_.count(keyframe.stamp_ns) > 0) return KeyframeDecision::duplicate;
  if (is_black(image)) return KeyframeDecision::black;
  if (input.low_visibility || keyframe.stamp_ns < low_visibility_until_ns_) {
    return KeyframeDecision::low_visibility;
  }
  return keyframe.held_out ? KeyframeDecision::held_out : KeyframeDecision::accepted;
}

KeyframeDecision Mapper::add(const MapperInput& input) {
  const torch::NoGradGuard no_grad;
  {
    const auto entry = times_.scope("poses");
    apply_pose_updates(input.moved);
    apply_loop_corrections(input.loop_corrections);
  }
  vio_failing_ = input.vio_failing;
  if (optimizer_) optimizer_->set_vio_failing(vio_failing_);
  if (input.low_visibility) {
    if (input.keyframe.stamp_ns >= low_visibility_until_ns_) {
      drop_low_visibility(input.keyframe.stamp_ns);
    }
    low_visibility_until_ns_ = input.keyframe.stamp_ns + kLowVisibilityMargin_ns;
  }
  const KeyframeDecision decision = validate(input);
  ++counts_[decision];
  if (decision == KeyframeDecision::held_out) {
    add_keyframe(input.keyframe);
    const auto leader = input.follows_ns ? by_stamp_.find(*input.follows_ns) : by_stamp_.end();
    if (leader != by_stamp_.end()) followers_[leader->second].push_back(keyframes_.size() - 1);
    thin_held_out();
  }
  if (decision != KeyframeDecision::accepted) return decision;
  detect_outage(input.keyframe.stamp_ns);
  add_keyframe(input.keyframe);
  const std::size_t view = keyframes_.size() - 1;
  schedule_.add(view);
  if (optimizer_) {
    const auto entry = times_.scope("gains");
    retry_on_oom([&] { optimizer_->match_gain(keyframes_, view); });
  }
  retry_on_oom([&] { align(view); });
  growth_budget_ += options_.online.densify_budget_fraction * static_cast<double>(room());
  insert_points(view, input);
  if (options_.trainer.densify.kind == Densification::random) {
    retry_on_oom([&] { insert_random(view); });
  }
  if (options_.trainer.densify.kind == Densification::quadtree) queue_depth(view, input.skip_depth);
  limit_image_memory();
  maybe_estimate_medium(input);
  return decision;
}

// When depth is deferred and the queue is full, every second keyframe is dropped, which keeps the
// rest evenly spread.
void Mapper::queue_depth(std::size_t view, bool skip_depth) {
  const auto every = static_cast<std::size_t>(options_.online.depth_every_keyframes);
  if (counts_[KeyframeDecision::accepted] % every == 0) depth_queue_.push_back(view);
  if (depth_queue_.size() * every <= static_cast<std::size_t>(options_.online.depth_lag_keyframes))
    return;
  if (!skip_depth) {
    retry_on_oom([&] { insert_from_depth(depth_queue_.front()); });
    return depth_queue_.pop_front();
  }
  if (depth_queue_.size() <= kMaxDepthQueue) return;
  std::deque<std::size_t> fewer;
  for (std::size_t k = 0; k < depth_queue_.size(); k += 2) fewer.push_back(depth_queue_[k]);
  depth_queue_ = std::move(fewer);
}

void Mapper::flush_depth_queue() {
  const torch::NoGradGuard no_grad;
  for (const std::size_t view : depth_queue_) {
    retry_on_oom([&] { insert_from_depth(view); });
  }
  depth_queue_.clear();
}

void Mapper::add_keyframe(const Keyframe& keyframe) {
  const std::size_t next = keyframes_.size();
  keyframes_.add(keyframe);
  map_odom_.add();
  keyframes_.set_pose(next, map_odom_.pose_in_map(next, keyframe.T_camera_world));
  by_stamp_[keyframe.stamp_ns] = next;
  if (optimizer_) {
    retry_on_oom([&] { optimizer_->add_view(); });
  }
}

// Visibility degrades gradually, so keyframes just before the loss are dropped as well.
void Mapper::drop_low_visibility(std::int64_t stamp_ns) {
  const auto first = by_stamp_.lower_bound(stamp_ns - kLowVisibilityMargin_ns);
  for (auto it = first; it != by_stamp_.end(); ++it) {
    const std::size_t view = it->second;
    if (!keyframes_[view].image.defined()) continue;
    const bool held_out = keyframes_[view].held_out;
    if (!held_out && keyframes_.training().size() <= kMinTrainingKeyframes) continue;
    --counts_[held_out ? KeyframeDecision::held_out : KeyframeDecision::accepted];
    ++counts_[KeyframeDecision::low_visibility];
    keyframes_.drop_image(view);
    if (!held_out) schedule_.remove(view);
    depth_queue_.erase(std::remove(depth_queue_.begin(), depth_queue_.end(), view),
                       depth_queue_.end());
  }
}

// Drops the older keyframe whose neighbors in time are closest to each other.
void Mapper::limit_image_memory() {
  const double max_bytes = options_.online.image_memory_mib * 1024.0 * 1024.0;
  const auto recent = static_cast<std::size_t>(std::max(2, options_.online.recent_keyframes));
  while (static_cast<double>(keyframes_.image_bytes()) > max_bytes) {
    const std::vector<std::size_t>& views = keyframes_.training();
    if (views.size() <= recent + 2) return;
    std::size_t redundant = views[1];
    double min_gap = std::numeric_limits<double>::infinity();
    for (std::size_t k = 1; k + recent < views.size(); ++k) {
      const Tensor before = camera_center(keyframes_[views[k - 1]].T_camera_world);
      const Tensor after = camera_center(keyframes_[views[k + 1]].T_camera_world);
      const double gap = (after - before).norm().item<double>();
      if (gap >= min_gap) continue;
      min_gap = gap;
      redundant = views[k];
    }
    keyframes_.drop_image(redundant);
    schedule_.remove(redundant);
  }
}

// When there are too many held-out images, doubles the stride and drops every second one. The
// stride counts the recording's images, so that the selection does not depend on lost frames and a
// simulator can predict which images need ground truth.
void Mapper::thin_held_out() {
  const auto is_dropped = [this](std::size_t i) {
    return keyframes_[i].number % heldout_stride_ != 0;
  };
  const std::size_t newest = keyframes_.size() - 1;
  if (is_dropped(newest)) return keyframes_.drop_image(newest);
  const auto max_views = static_cast<std::size_t>(std::max(1, options_.online.max_heldout_views));
  if (keyframes_.held_out().size() <= max_views) return;
  heldout_stride_ *= 2;
  const std::vector<std::size_t> all = keyframes_.held_out();
  for (const std::size_t i : all) {
    if (is_dropped(i)) keyframes_.drop_image(i);
  }
}

void Mapper::detect_outage(std::int64_t stamp_ns) {
  const std::vector<std::size_t>& views = keyframes_.training();
  if (views.empty() || stamp_ns - keyframes_[views.back()].stamp_ns < kOutage_ns) return;
  medium_schedule_.images_resumed(counts_[KeyframeDecision::accepted]);
}

// Under load, only the first estimation runs; later ones are deferred.
void Mapper::maybe_estimate_medium(const MapperInput& input) {
  if (!options_.medium || !optimizer_ || size() == 0) return;
  if (optimizer_->medium() && (input.skip_depth || input.skip_medium_fit)) return;
  const std::size_t accepted = counts_[KeyframeDecision::accepted];
  if (!medium_schedule_.is_due(accepted)) return;
  medium_schedule_.mark_estimated(accepted);
  retry_on_oom([&] { estimate_medium(); });
}

void Mapper::estimate_medium() {
  const torch::NoGradGuard no_grad;
  const auto entry = times_.scope("water");
  if (options_.trainer.medium_estimation == MediumEstimationMethod::fit) {
    fit_medium();
  } else if (!optimizer_->medium()) {
    start_medium();
  }
  optimizer_->set_vio_failing(vio_failing_);
}

void Mapper::start_medium() {
  optimizer_->start_medium(initial_medium(optimizer_->map(), keyframes_), keyframes_);
  schedule_.reset_penalties();
}

void Mapper::fit_medium() {
  const Map map = optimizer_->full_map();
  const medium::MediumPrior prior =
      medium::default_medium_prior(options_.trainer.lamp, optimizer_->medium_posterior());
  const auto estimation = mapping::estimate_medium(
      map, keyframes_, kMediumViewSpacing * extent_, prior,
      derive_seed(options_.trainer.seed, Stream::medium, iteration_), options_.depth);
  if (estimation) {
    log::debug("medium estimated after {} keyframes from {} of them{}, relative sigma {:.0f} %",
               keyframes_.training().size(), estimation->views.size(),
               estimation->sees_open_water ? " and open water" : "",
               100.0 * estimation->fit.sigmas.mean().item<double>());
    optimizer_->apply_medium(*estimation, keyframes_);
    schedule_.reset_penalties();
  } else if (!optimizer_->medium()) {
    optimizer_->apply_medium(medium::coastal_medium(), torch::zeros({3, 3, 3}, torch::kFloat64),
                             keyframes_);
  }
}

// New keyframes start at low resolution.
int Mapper::reduction(std::size_t view) const {
  const int levels = static_cast<int>(std::lround(std::log2(options_.trainer.initial_downscale)));
  if (final_start_ || options_.online.uses_per_pyramid_level <= 0) return 1;
  const auto passed =
      static_cast<int>(schedule_.uses(view) / options_.online.uses_per_pyramid_level);
  return 1 << std::max(0, levels - passed);
}

LearningRates Mapper::rates() const {
  const OnlineOptions& online = options_.online;
  const double early = std::exp(-static_cast<double>(iteration_) / online.rate_decay_steps);
  return options_.trainer.learning_rates.times(online.final_rate_factor +
                                               (1.0 - online.final_rate_factor) * early);
}

double Mapper::step() {
  TORCH_CHECK(ready(), "mapper: no Gaussians or no keyframes to optimize yet");
  const Stopwatch watch;
  const auto entry = times_.scope("steps");
  Random random(derive_seed(options_.trainer.seed, Stream::order, iteration_));
  const std::size_t view = schedule_.draw(random);
  const auto degree = static_cast<int>(iteration_ / options_.trainer.sh_degree_interval);
  const bool correct =
      final_start_ && progress() >= options_.trainer.pose_refinement.start_fraction;
  const StepSettings settings = {.reduction = reduction(view),
                                 .sh_degree = std::min(options_.trainer.sh_degree, degree),
                                 .correct_pose = correct,
                                 .rates = rates_at(rates(), extent_, progress())};
  retry_on_oom([&] { losses_.add(view, optimizer_->step(keyframes_, view, settings)); });
  schedule_.use(view);
  for (const auto& [i, value] : losses_.take()) schedule_.report(i, value);
  ++iteration_;
  maybe_densify();
  if (final_start_) final_seconds_ += watch.seconds();
  return losses_.newest();
}

// About the number of steps that two keyframes get, within bounds.
std::int64_t Mapper::densify_interval_steps() const {
  const std::int64_t min_steps = options_.trainer.densify.interval;
  const std::int64_t max_steps = options_.online.max_densify_interval;
  const auto views = static_cast<std::int64_t>(std::max<std::size_t>(1, schedule_.size()));
  return std::max(min_steps, std::min(max_steps, 2 * iteration_ / views));
}

void Mapper::maybe_densify() {
  const std::int64_t passed = iteration_ - last_densify_;
  if (final_start_ || options_.trainer.densify.kind == Densification::none) return;
  if (passed < densify_interval_steps()) return;
  last_densify_ = iteration_;
  const auto entry = times_.scope("growth");
  const std::int64_t before = size();
  DensifyResult result;
  retry_on_oom([&] {
    const std::int64_t limit = size() + std::min(static_cast<std::int64_t>(growth_budget_), room());
    result = optimizer_->densify(
        extent_, limit, derive_seed(options_.trainer.seed, Stream::split, iteration_), passed);
  });
  growth_budget_ -= static_cast<double>(std::max<std::int64_t>(0, size() - before));
  log::debug("iteration {}: {} cloned, {} split, {} pruned: {} Gaussians", iteration_,
             result.cloned, result.split, result.pruned, size());
}

void Mapper::begin_final() {
  if (final_start_) return;
  const torch::NoGradGuard no_grad;
  // Needs iterations afterwards: new Gaussians and a new medium, which changes colors and gains at
  // once, take steps to converge.
  if (options_.trainer.final_iterations > 0) {
    flush_depth_queue();
    if (options_.medium && optimizer_ && size() > 0) {
      retry_on_oom([&] { estimate_medium(); });
    }
  }
  schedule_.disable_recency_bias();
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

// Moves images to the host first, which costs only time.
bool Mapper::reduce_memory() {
  if (size() < kMinGaussiansToShrink) return false;
  if (keyframes_.device().is_cpu()) {
    return shrink_map(*optimizer_, options_.trainer.densify.max_gaussians);
  }
  log::warning("out of GPU memory: keyframe images are moved to host memory");
  keyframes_.move_images(torch::kCPU);
  return true;
}

void Mapper::retry_on_oom(const std::function<void()>& work) {
  mapping::retry_on_oom(work, [this] { return reduce_memory(); });
}

Map Mapper::map() const {
  if (optimizer_) return optimizer_->full_map();
  return {.gaussians = gaussians::Gaussians::empty(options_.trainer.sh_degree, torch::kFloat32),
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
  return optimizer_ ? corrected_pose(given, optimizer_->corrections().pose_delta(i, false)) : given;
}

}  // namespace apvi::mapping
