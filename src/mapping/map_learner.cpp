// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/map_learner.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "apvi/mapping/seeds.hpp"
#include "apvi/splat/losses.hpp"
#include "apvi/splat/medium_backend.hpp"
#include "apvi/splat/medium_estimate.hpp"
#include "apvi/splat/ply.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

static_assert(kMostShDegree == splat::kMaxShDegree);

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

splat::GaussianRates rates_at(const LearningRates& r, double extent, double progress) {
  const double first = std::log(std::max(1e-20, r.means));
  const double last = std::log(std::max(1e-20, r.means_final));
  const double late = std::max(0.0, 2.0 * progress - 1.0);
  const double factor = std::pow(r.late_factor, late);
  return {.means = extent * std::exp(first + progress * (last - first)),
          .log_scales = factor * r.log_scales,
          .quaternions = factor * r.quaternions,
          .logit_opacities = factor * r.logit_opacities,
          .sh_dc = factor * r.sh_dc,
          .sh_rest = factor * r.sh_rest};
}

MapLearner::MapLearner(const splat::Gaussians& initial, const TrainerOptions& options,
                       std::size_t views, const std::optional<splat::Medium>& medium)
    : options_(options),
      store_(on_device(initial)),
      statistics_(initial.size(), splat::active_device()),
      corrections_(views, options.poses, options.exposure) {
  if (medium) medium_.emplace(on_device(*medium));
}

Tensor MapLearner::image_of(std::size_t view, const splat::View& camera,
                            const splat::RenderOutput& out) {
  Tensor image = out.color;
  if (medium_) {
    image = splat::apply_medium(image, splat::depth_to_range(out.depth, camera.intrinsics),
                                out.alpha, medium_->medium());
  }
  return corrections_.expose(view, image, /*learn=*/true);
}

Tensor MapLearner::step(const KeyframeStore& keyframes, std::size_t i,
                        const StepSettings& settings) {
  splat::View camera = keyframes.view(i, settings.reduction);
  camera.pose_delta = corrections_.pose_delta(i, settings.correct_pose);
  const splat::RenderOutput out = splat::render(
      store_.view(), camera,
      {.sh_degree = settings.sh_degree, .antialiased = options_.antialiased, .background = {}});
  const Tensor target = keyframes.image(i, settings.reduction, out.color.device());
  const Tensor loss =
      splat::photometric_loss(image_of(i, camera, out), target, options_.ssim_weight);
  loss.backward();
  statistics_.observe(out.statistics);
  store_.step(settings.rates, {}, options_.sparse_adam ? out.statistics.visible : Tensor());
  corrections_.step(i, camera.pose_delta);
  if (medium_) medium_->step();
  return loss.detach();
}

void MapLearner::forget_statistics() {
  statistics_ = DensityStatistics(store_.size(), splat::active_device());
}

DensifyResult MapLearner::densify(double extent, std::int64_t limit, std::uint64_t seed) {
  const DensifyResult result =
      mapping::densify(store_, statistics_, options_.densify, extent, limit, seed);
  forget_statistics();
  return result;
}

void MapLearner::insert(const splat::Gaussians& gaussians, const Tensor& anchors) {
  store_.insert(gaussians, anchors);
  statistics_.extend(gaussians.size());
}

void MapLearner::remove(const Tensor& remove) {
  store_.prune(remove);
  statistics_.keep(remove.logical_not());
}

void MapLearner::move(std::int64_t anchor, const splat::Similarity& motion) {
  const Tensor own = store_.anchors() == anchor;
  if (own.any().item<bool>()) store_.transform(motion, own);
}

void MapLearner::begin_medium(const splat::Medium& medium, const Tensor& ranges) {
  const torch::NoGradGuard no_grad;
  const splat::Medium water = on_device(medium);
  Tensor sh_dc = map().sh_dc;
  const Tensor seen = splat::sh_dc_to_color(sh_dc);
  sh_dc.copy_(splat::color_to_sh_dc(without_water(seen, ranges.to(seen.options()), water)));
  medium_.emplace(water);
}

void MapLearner::set_vio_failing(bool failing) {
  if (medium_) medium_->set_vio_failing(failing);
}

splat::Gaussians MapLearner::map() const {
  const splat::Gaussians& view = store_.view();
  splat::Gaussians map;
  const auto from = view.tensors();
  const auto to = map.tensors();
  for (std::size_t i = 0; i < from.size(); ++i) *to[i] = from[i]->detach();
  return map;
}

std::optional<splat::Medium> MapLearner::medium() const {
  if (!medium_) return std::nullopt;
  const splat::Medium water = medium_->medium();
  return splat::Medium{.beta_d = water.beta_d.detach(),
                       .beta_b = water.beta_b.detach(),
                       .b_inf = water.b_inf.detach()};
}

std::optional<double> MapLearner::medium_rate() const {
  return medium_ ? std::optional(medium_->rate()) : std::nullopt;
}

void MapLearner::save(torch::serialize::OutputArchive& archive) const {
  const auto child = [&archive](const char* name, const auto& part) {
    torch::serialize::OutputArchive inner;
    part.save(inner);
    archive.write(name, inner);
  };
  child("map", store_);
  child("statistics", statistics_);
  child("corrections", corrections_);
  if (medium_) child("medium", *medium_);
  archive.write("has_medium", torch::IValue(medium_.has_value()));
}

void MapLearner::load(torch::serialize::InputArchive& archive) {
  torch::serialize::InputArchive part;
  archive.read("map", part);
  store_ = splat::GaussianStore::load(part, splat::active_device());
  archive.read("statistics", part);
  statistics_.load(part);
  archive.read("corrections", part);
  corrections_.load(part);
  c10::IValue has_medium;
  archive.read("has_medium", has_medium);
  if (!has_medium.toBool()) return medium_.reset();
  if (!medium_) medium_.emplace(on_device(splat::coastal_medium()));
  archive.read("medium", part);
  medium_->load(part);
}

}  // namespace apvi::mapping
