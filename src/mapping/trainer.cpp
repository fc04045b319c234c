// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/trainer.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <istream>
#include <numeric>
#include <ostream>
#include <utility>

#include "apvi/core/atomic_file.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/core/random.hpp"
#include "apvi/core/stopwatch.hpp"
#include "apvi/mapping/random_insertion.hpp"
#include "apvi/splat/losses.hpp"
#include "apvi/splat/medium_backend.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

static_assert(kMostShDegree == splat::kMaxShDegree);

// Separate streams of random numbers, so that one more draw in one place changes no other.
enum class Stream : std::uint64_t { order = 1, split = 2, insertion = 3 };

std::uint64_t seed_of(std::uint64_t seed, Stream stream, std::int64_t round) {
  Random random = Random(seed).fork(static_cast<std::uint64_t>(stream));
  return random.fork(static_cast<std::uint64_t>(round)).next();
}

splat::Gaussians on_device(const splat::Gaussians& gaussians) {
  splat::Gaussians moved;
  const auto from = gaussians.tensors();
  const auto to = moved.tensors();
  for (std::size_t i = 0; i < from.size(); ++i) {
    *to[i] = from[i]->to(splat::active_device(), torch::kFloat32);
  }
  return moved;
}

splat::Medium on_device(const splat::Medium& medium) {
  const auto moved = [](const Tensor& values) {
    return values.detach().to(splat::active_device(), torch::kFloat32);
  };
  return {
      .beta_d = moved(medium.beta_d), .beta_b = moved(medium.beta_b), .b_inf = moved(medium.b_inf)};
}

}  // namespace

Trainer::Trainer(const KeyframeStore& keyframes, const splat::Gaussians& initial,
                 const TrainerOptions& options, const std::optional<splat::Medium>& medium)
    : keyframes_(keyframes),
      options_(options),
      extent_(scene_extent(keyframes)),
      initial_size_(initial.size()),
      store_(on_device(initial)),
      statistics_(initial.size(), splat::active_device()),
      corrections_(keyframes.size(), options.poses, options.exposure) {
  TORCH_CHECK(!keyframes.training().empty(), "trainer: there are no keyframes to learn from");
  TORCH_CHECK(initial.size() > 0, "trainer: the initial map is empty");
  if (medium) medium_.emplace(on_device(*medium));
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

splat::RenderOptions Trainer::render_options() const {
  const auto degree = static_cast<int>(iteration_ / options_.sh_interval);
  return {.sh_degree = std::min(options_.sh_degree, degree),
          .antialiased = options_.antialiased,
          .background = {}};
}

splat::GaussianRates Trainer::rates() const {
  const LearningRates& r = options_.rates;
  const double first = std::log(std::max(1e-20, r.means));
  const double last = std::log(std::max(1e-20, r.means_final));
  const double late = std::max(0.0, 2.0 * progress() - 1.0);
  const double factor = std::pow(r.late_factor, late);
  return {.means = extent_ * std::exp(first + progress() * (last - first)),
          .log_scales = factor * r.log_scales,
          .quaternions = factor * r.quaternions,
          .logit_opacities = factor * r.logit_opacities,
          .sh_dc = factor * r.sh_dc,
          .sh_rest = factor * r.sh_rest};
}

Tensor Trainer::image_of(std::size_t view, const splat::View& camera,
                         const splat::RenderOutput& out) {
  Tensor image = out.color;
  if (medium_) {
    image = splat::apply_medium(image, splat::depth_to_range(out.depth, camera.intrinsics),
                                out.alpha, medium_->medium());
  }
  return corrections_.expose(view, image, /*learn=*/true);
}

double Trainer::step() {
  const Stopwatch watch;
  const std::size_t i = choose_view();
  const int factor = reduction();
  splat::View camera = keyframes_.view(i, factor);
  camera.pose_delta = corrections_.pose_delta(i, progress() >= options_.poses.begin);
  const splat::RenderOutput out = splat::render(store_.view(), camera, render_options());
  const Tensor target = keyframes_.image(i, factor, out.color.device());
  const Tensor loss =
      splat::photometric_loss(image_of(i, camera, out), target, options_.ssim_weight);
  loss.backward();
  statistics_.observe(out.statistics);
  store_.step(rates(), {}, options_.sparse_adam ? out.statistics.visible : Tensor());
  corrections_.step(i, camera.pose_delta);
  if (medium_) medium_->step();
  ++iteration_;
  maybe_densify();
  seconds_ += watch.seconds();
  return loss.item<double>();
}

void Trainer::maybe_densify() {
  const DensifyOptions& d = options_.densify;
  if (d.kind == Densification::none || iteration_ % d.interval != 0) return;
  const double p = progress();
  if (p < d.begin || p > d.end || iteration_ > options_.iterations) return;
  const double part = (p - d.begin) / std::max(1e-9, d.end - d.begin);
  const std::int64_t growth = std::max<std::int64_t>(0, d.max_gaussians - initial_size_);
  const std::int64_t limit =
      initial_size_ + static_cast<std::int64_t>(part * static_cast<double>(growth));
  if (d.kind != Densification::gradient) insert_random();
  const DensifyResult result = densify(store_, statistics_, d, extent_, limit,
                                       seed_of(options_.seed, Stream::split, iteration_));
  log::debug("iteration {}: {} cloned, {} split, {} pruned: {} Gaussians", iteration_,
             result.cloned, result.split, result.pruned, store_.size());
  statistics_ = DensityStatistics(store_.size(), splat::active_device());
}

void Trainer::insert_random() {
  const auto& training = keyframes_.training();
  Random random(seed_of(options_.seed, Stream::insertion, iteration_));
  const std::size_t view = training[static_cast<std::size_t>(random.next() % training.size())];
  const std::int64_t room = options_.densify.max_gaussians - store_.size();
  const std::int64_t count = std::min<std::int64_t>(options_.densify.random_per_round, room);
  if (count <= 0) return;
  store_.insert(random_gaussians(map(), keyframes_, view, count, extent_, random));
  statistics_.extend(count);
}

splat::Gaussians Trainer::map() const {
  // A view of the store changes nothing but its cache.
  const splat::Gaussians& view = const_cast<splat::GaussianStore&>(store_).view();
  splat::Gaussians map;
  const auto from = view.tensors();
  const auto to = map.tensors();
  for (std::size_t i = 0; i < from.size(); ++i) *to[i] = from[i]->detach();
  return map;
}

std::optional<splat::Medium> Trainer::medium() const {
  if (!medium_) return std::nullopt;
  const splat::Medium water = medium_->medium();
  return splat::Medium{.beta_d = water.beta_d.detach(),
                       .beta_b = water.beta_b.detach(),
                       .b_inf = water.b_inf.detach()};
}

void Trainer::save(const std::filesystem::path& checkpoint) const {
  torch::serialize::OutputArchive archive;
  const auto child = [&archive](const char* name, const auto& part) {
    torch::serialize::OutputArchive inner;
    part.save(inner);
    archive.write(name, inner);
  };
  child("map", store_);
  child("statistics", statistics_);
  child("corrections", corrections_);
  if (medium_) child("medium", *medium_);
  archive.write("iteration", torch::IValue(iteration_));
  archive.write("seconds", torch::IValue(seconds_));
  archive.write("initial_size", torch::IValue(initial_size_));
  write_file_atomically(checkpoint, [&archive](std::ostream& out) { archive.save_to(out); });
}

void Trainer::resume(const std::filesystem::path& checkpoint) {
  try {
    torch::serialize::InputArchive archive;
    archive.load_from(checkpoint.string());
    torch::serialize::InputArchive part;
    archive.read("map", part);
    store_ = splat::GaussianStore::load(part, splat::active_device());
    archive.read("statistics", part);
    statistics_.load(part);
    archive.read("corrections", part);
    corrections_.load(part);
    if (medium_) {
      archive.read("medium", part);
      medium_->load(part);
    }
    c10::IValue value;
    archive.read("iteration", value);
    iteration_ = value.toInt();
    archive.read("seconds", value);
    seconds_ = value.toDouble();
    archive.read("initial_size", value);
    initial_size_ = value.toInt();
  } catch (const c10::Error& e) {
    fail_input("{}: cannot be resumed: {}; delete it to start anew", checkpoint.string(),
               e.what_without_backtrace());
  }
}

}  // namespace apvi::mapping
