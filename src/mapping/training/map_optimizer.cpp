// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/training/map_optimizer.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "gaussians/device.hpp"
#include "gaussians/metrics/losses.hpp"
#include "gaussians/model/archive.hpp"
#include "gaussians/model/morton.hpp"
#include "mapping/density/gaussian_limit.hpp"
#include "mapping/depth_curvature_loss.hpp"
#include "mapping/medium/open_water.hpp"
#include "mapping/training/robust_weights.hpp"
#include "mapping/training/step_backend.hpp"
#include "mapping/training/step_constants.hpp"
#include "medium/medium_initialization.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr int kGainReduction = 4;  // image reduction for a new view's initial gain
// Slowly changing parts run only every so many steps: on a GPU the time of a step is dominated by
// the number of kernel launches, and together these launch as many as the rest of the step.
constexpr std::int64_t kGainInterval = 2;
constexpr std::int64_t kMedianGainInterval = 50;
constexpr std::int64_t kMediumInterval = 8;  // once the medium has a prior
constexpr std::int64_t kReorderInterval = 1000;
constexpr std::int64_t kOpacityInterval = 4;
constexpr std::int64_t kSmoothnessInterval = 8;

static_assert(kShDegreeLimit == gaussians::kMaxShDegree);

gaussians::Gaussians on_device(const gaussians::Gaussians& gaussians) {
  gaussians::Gaussians copy;
  const auto from = gaussians.tensors();
  const auto to = copy.tensors();
  for (std::size_t i = 0; i < from.size(); ++i) {
    *to[i] = from[i]->to(gaussians::active_device(), torch::kFloat32);
  }
  return copy;
}

// Gains are not estimated from saturated pixels.
Tensor without_hidden(const Tensor& image, const Tensor& scene) {
  if (!scene.defined()) return image;
  return image.masked_fill(scene.logical_not().unsqueeze(2), step::kSaturated);
}

template <typename Part>
void save_part(torch::serialize::OutputArchive& archive, const char* name, const Part& part) {
  torch::serialize::OutputArchive inner;
  part.save(inner);
  archive.write(name, inner);
}

}  // namespace

gaussians::GaussianLearningRates rates_at(const LearningRates& r, double extent, double progress) {
  const double first = std::log(std::max(1e-20, r.means));
  const double last = std::log(std::max(1e-20, r.means_final));
  const double late = std::max(0.0, 2.0 * progress - 1.0);
  const double factor = std::pow(r.final_factor, late);
  return {.means = extent * std::exp(first + progress * (last - first)),
          .log_scales = factor * r.log_scales,
          .quaternions = factor * r.quaternions,
          .logit_opacities = factor * r.logit_opacities,
          .sh_dc = factor * r.sh_dc,
          .sh_rest = factor * r.sh_rest};
}

MapOptimizer::MapOptimizer(const gaussians::Gaussians& initial, const TrainerOptions& options,
                           std::size_t views, const std::optional<medium::Medium>& medium)
    : MapOptimizer(std::make_shared<SharedGaussians>(SharedGaussians{
                       .store = gaussians::GaussianStore(on_device(initial)),
                       .statistics = DensityStatistics(initial.size(), gaussians::active_device()),
                       .max_gaussians = gaussian_limit(options.densify)}),
                   options, views, medium) {}

MapOptimizer::MapOptimizer(std::shared_ptr<SharedGaussians> shared, const TrainerOptions& options,
                           std::size_t views, const std::optional<medium::Medium>& medium)
    : options_(options),
      shared_(std::move(shared)),
      corrections_(views, options.pose_refinement, options.exposure_correction),
      gains_(views, gaussians::active_device()),
      tone_curve_evidence_(options.tone_curve),
      tone_curve_(tone_curve_evidence_.initial()) {
  if (options.robust_weights) robust_weights_ = std::make_shared<RobustWeights>(views);
  if (medium) create_medium(*medium);
}

MapOptimizer MapOptimizer::session(const TrainerOptions& options, std::size_t views,
                                   const std::optional<medium::Medium>& medium,
                                   const Tensor& light) {
  shared_->has_sessions = true;
  MapOptimizer other(shared_, options, views, medium);
  other.light_.emplace(light, gaussians::active_device());
  return other;
}

const medium::MediumView& MapOptimizer::medium_view(const gaussians::Intrinsics& camera) {
  const auto cached = medium_views_.find(camera.width);
  if (cached != medium_views_.end()) return cached->second;
  return medium_views_.emplace(camera.width, medium::MediumView(*medium(), camera)).first->second;
}

bool MapOptimizer::optimizes_medium() const {
  return medium_ && (!medium_->has_prior() || shared_->store.steps() % kMediumInterval == 0);
}

bool MapOptimizer::updates_gain(const StepSettings& settings) const {
  return options_.gain_compensation && settings.match_gain &&
         shared_->store.steps() % kGainInterval == 0;
}

Tensor MapOptimizer::step(const KeyframeStore& keyframes, std::size_t i,
                          const StepSettings& settings) {
  gaussians::View camera = keyframes.view(i, settings.reduction);
  camera.pose_delta = corrections_.pose_delta(i, settings.correct_pose);
  const bool update_medium = optimizes_medium();
  std::optional<medium::MediumView> differentiable;
  if (update_medium) differentiable = medium_view(camera.intrinsics).with(medium_->medium());
  const medium::MediumView* const water =
      update_medium ? &*differentiable : (medium_ ? &medium_view(camera.intrinsics) : nullptr);
  const gaussians::RenderOutput out = gaussians::render(
      shared_->store.view(), camera,
      {.sh_degree = settings.sh_degree,
       .antialiased = options_.antialiased,
       .background = {},
       .light = water ? water->illumination_at(shared_->store.view().means, camera.T_camera_world)
                      : Tensor(),
       .sparse_gradient = true});
  const Tensor color = light_ ? out.color * light_->color(/*learn=*/true) : out.color;
  const Tensor seen = water ? water->apply(color, out.depth, out.alpha) : color;
  const bool lit = illumination_ && settings.match_gain;
  const Tensor image = corrections_.expose(
      i, lit ? illumination_->apply(i, seen, 1.0 / tone_curve_.exponent()) : seen,
      /*learn=*/true);
  const bool add_opacity_loss = water != nullptr && shared_->store.steps() % kOpacityInterval == 0;
  const bool needs_open_water = add_opacity_loss || (water != nullptr && updates_gain(settings));
  const Tensor scene = keyframes.scene(i, settings.reduction, image.device());
  const RenderedView rendered = {.image = image.detach(),
                                 .alpha = out.alpha.detach(),
                                 .open_water = needs_open_water ? water->open_water() : Tensor(),
                                 .horizon = horizon(camera)};
  const Target target = target_of(keyframes, i, rendered, settings);
  const Tensor drawn = tone_curve_.encode(image);
  const Tensor wanted = tone_curve_.encode(target.saturation_adjusted(rendered.image));
  const Tensor weights = pixel_weights(i, rendered, drawn.detach(), wanted, scene);
  Tensor loss = gaussians::photometric_loss(drawn, wanted, options_.ssim_weight, weights);
  if (options_.depth_curvature_weight > 0.0 &&
      shared_->store.steps() % kSmoothnessInterval == kSmoothnessInterval / 2) {
    loss = loss + options_.depth_curvature_weight *
                      depth_curvature_loss(out.depth, rendered.alpha, target.image);
  }
  if (add_opacity_loss) {
    const OpacityWeights& opacity_weights =
        water->has_lamp() ? kLampOpacityWeights : kDaylightOpacityWeights;
    Tensor opacity_gradient =
        opacity_loss_gradient(target.saturation_adjusted(rendered.open_water), rendered.open_water,
                              rendered.alpha, opacity_weights);
    if (weights.defined()) opacity_gradient = opacity_gradient * weights;
    torch::autograd::backward({loss, out.alpha}, {Tensor(), opacity_gradient});
  } else {
    loss.backward();
  }
  shared_->statistics.observe(out.statistics);
  const bool sparse = options_.sparse_adam.value_or(false);
  if (out.sparse_gradient != nullptr) {
    shared_->store.step(settings.rates, *out.sparse_gradient, sparse);
  } else {
    shared_->store.step(settings.rates, {}, sparse ? out.statistics.visible : Tensor());
  }
  corrections_.step(i, camera.pose_delta);
  if (shared_->store.steps() % kMedianGainInterval == 0) gains_.restore_median();
  if (lit) illumination_->step(i);
  if (light_) light_->step();
  if (update_medium) {
    medium_->step();
    const medium::Medium now = *medium();
    for (auto& [width, view] : medium_views_) view = view.with(now);
  }
  return loss.detach();
}

// Of the pixels [h,w]; undefined: all one.
Tensor MapOptimizer::pixel_weights(std::size_t i, const RenderedView& rendered, const Tensor& drawn,
                                   const Tensor& wanted, const Tensor& scene) {
  if (!robust_weights_) return scene;
  const Tensor image = scene.defined() ? torch::where(scene.unsqueeze(2), wanted, drawn) : wanted;
  Tensor weights =
      robust_weights_->weigh(i, {.rendered = drawn, .alpha = rendered.alpha, .image = image});
  if (!scene.defined()) return weights;
  return weights.defined() ? weights * scene : scene;
}

Tensor MapOptimizer::Target::saturation_adjusted(const Tensor& colors) const {
  if (!saturated.defined()) return image;
  return torch::where(saturated, torch::maximum(image, colors), image);
}

MapOptimizer::Target MapOptimizer::target_of(const KeyframeStore& keyframes, std::size_t i,
                                             const RenderedView& rendered,
                                             const StepSettings& settings) {
  const torch::Device device = rendered.image.device();
  const StepBackend& backend = step_backend(device);
  TargetInput input = {.image = keyframes.pixels(i).to(device),
                       .reduction = settings.reduction,
                       .falloff = vignetting_.is_none()
                                      ? Tensor()
                                      : falloff(keyframes.view(i, settings.reduction).intrinsics),
                       .log_gain = {},
                       .light = light_table(device)};
  if (options_.gain_compensation) {
    if (updates_gain(settings)) {
      gains_.track(i, rendered,
                   without_hidden(without_outliers(i, rendered.image, backend.target(input)),
                                  keyframes.scene(i, settings.reduction, device)));
    }
    input.log_gain = gains_.log_gain(i);
  }
  Target target = {.image = backend.target(input), .saturated = {}};
  if (keyframes[i].saturates) {
    target.saturated = backend.saturated(input.image, input.reduction);
  }
  return target;
}

// What moves says nothing about the exposure: there the image is what the present gain expects.
Tensor MapOptimizer::without_outliers(std::size_t i, const Tensor& rendered,
                                      const Tensor& image) const {
  if (!robust_weights_) return image;
  const Tensor lowered = robust_weights_->lowered(i, image.size(0), image.size(1));
  return torch::where(lowered.to(image.device()).unsqueeze(2), rendered * gains_.log_gain(i).exp(),
                      image);
}

DensifyResult MapOptimizer::densify(double extent, std::int64_t limit, std::uint64_t seed,
                                    std::int64_t passed) {
  const DensifyResult result =
      mapping::densify(shared_->store, shared_->statistics, options_.densify, extent, limit, seed);
  shared_->statistics.begin_round();
  // The interval is derived from state that checkpoints contain.
  if (shared_->store.steps() % kReorderInterval < passed) reorder();
  return result;
}

void MapOptimizer::reorder() {
  const Tensor order = gaussians::morton_order(shared_->store.view().means);
  shared_->store.reorder(order);
  shared_->statistics.reorder(order);
}

void MapOptimizer::insert(const gaussians::Gaussians& gaussians, const Tensor& anchors) {
  shared_->store.insert(gaussians, anchors);
  shared_->statistics.extend(gaussians.size());
}

void MapOptimizer::remove(const Tensor& remove) {
  shared_->store.prune(remove);
  shared_->statistics.keep(remove.logical_not());
}

void MapOptimizer::prune_least_important(std::int64_t count, const Tensor& among) {
  if (count <= 0) return;
  Tensor order = shared_->statistics.importance();
  if (among.defined()) order = order.masked_fill(~among, std::numeric_limits<float>::infinity());
  Tensor pruned = torch::zeros_like(order, order.options().dtype(torch::kBool));
  pruned.index_fill_(0, std::get<1>(order.topk(count, 0, /*largest=*/false)), true);
  remove(pruned);
}

void MapOptimizer::keep_most_important(int count) {
  const torch::NoGradGuard no_grad;
  shared_->max_gaussians = count;
  if (!shared_->statistics.has_size(size())) shared_->statistics = DensityStatistics(size());
  move_to(torch::kCPU);
  prune_least_important(size() - count);
  move_to(gaussians::active_device());
}

std::int64_t MapOptimizer::room() const {
  return std::max<std::int64_t>(0, shared_->max_gaussians - size());
}

void MapOptimizer::move_to(const torch::Device& device) {
  shared_->store.to(device);
  shared_->statistics.to(device);
}

void MapOptimizer::move(const std::map<std::int64_t, Tensor>& motions) {
  if (motions.empty() || size() == 0) return;
  // Index of the motion by anchor + 1; entry 0 is for Gaussians that do not move.
  std::vector<std::int64_t> which(2 + static_cast<std::size_t>(motions.rbegin()->first), -1);
  std::vector<Tensor> transforms;
  for (const auto& [anchor, motion] : motions) {
    which[1 + static_cast<std::size_t>(anchor)] = static_cast<std::int64_t>(transforms.size());
    transforms.push_back(motion);
  }
  const Tensor anchors = shared_->store.anchors();
  const auto last = static_cast<std::int64_t>(which.size()) - 1;
  const Tensor lookup = torch::tensor(which, torch::kInt64).to(anchors.device());
  const Tensor index = lookup.index_select(0, torch::where(anchors < last, anchors + 1, 0));
  shared_->store.transform(gaussians::rigid_transforms(torch::stack(transforms)), index);
}

void MapOptimizer::change_scale(const gaussians::ScaleChange& change) {
  const torch::NoGradGuard no_grad;
  corrections_.change_scale(change.scale);
  if (medium_) {
    medium::Medium water = *medium();
    water.beta_d = water.beta_d / change.scale;
    water.beta_b = water.beta_b / change.scale;
    create_medium(water);
    medium_views_.clear();
  }
  medium_posterior_ = {};
  if (size() == 0) return;
  const Tensor all = torch::zeros({size()}, torch::kInt64);
  shared_->store.transform(gaussians::scaling(change), all);
  shared_->store.reset_momentum(torch::ones({size()}, torch::kBool));
}

void MapOptimizer::add_view() {
  corrections_.add_view();
  gains_.add_view();
  if (robust_weights_) robust_weights_->add_view();
}

const Tensor& MapOptimizer::light_table(const torch::Device& device) {
  if (!light_table_.defined()) light_table_ = tone_curve_.byte_table(device);
  return light_table_;
}

Tensor MapOptimizer::falloff(const gaussians::Intrinsics& camera) {
  Tensor& cached = falloffs_[camera.width];
  if (!cached.defined()) cached = lens_falloff(camera, vignetting_, gaussians::active_device());
  return cached;
}

std::pair<RenderedView, Tensor> MapOptimizer::gain_images(const KeyframeStore& keyframes,
                                                          std::size_t i) {
  const gaussians::View camera = keyframes.view(i, kGainReduction);
  const MapRendering rendered = render_map(full_map(), camera);
  const torch::Device device = rendered.alpha.device();
  const Tensor image = step_backend(device).target(
      {.image = keyframes.pixels(i).to(device),
       .reduction = kGainReduction,
       .falloff = vignetting_.is_none() ? Tensor() : falloff(camera.intrinsics),
       .log_gain = {},
       .light = light_table(device)});
  return {{.image = rendered.color,
           .alpha = rendered.alpha,
           .open_water = medium_ ? medium_view(camera.intrinsics).open_water() : Tensor(),
           .horizon = horizon(camera)},
          without_hidden(image, keyframes.scene(i, kGainReduction, device))};
}

void MapOptimizer::match_gain(const KeyframeStore& keyframes, std::size_t i) {
  if (!options_.gain_compensation || size() == 0) return;
  const torch::NoGradGuard no_grad;
  const auto [rendered, image] = gain_images(keyframes, i);
  gains_.initialize(i, rendered, image);
}

void MapOptimizer::measure_gain(const KeyframeStore& keyframes, std::size_t i) {
  if (!options_.gain_compensation || size() == 0) return;
  const torch::NoGradGuard no_grad;
  const auto [rendered, image] = gain_images(keyframes, i);
  gains_.measure(i, rendered, image);
}

void MapOptimizer::track_illumination(const KeyframeStore& keyframes) {
  if (!options_.gain_compensation) return;
  illumination_.emplace(keyframes.size(), keyframes.training(), keyframes[0].intrinsics,
                        gaussians::active_device());
}

void MapOptimizer::set_vio_failing(bool failing) {
  vio_failing_ = failing;
  if (medium_) medium_->set_vio_failing(failing);
}

gaussians::Gaussians MapOptimizer::map() const {
  const gaussians::Gaussians& view = shared_->store.view();
  gaussians::Gaussians map;
  const auto from = view.tensors();
  const auto to = map.tensors();
  for (std::size_t i = 0; i < from.size(); ++i) *to[i] = from[i]->detach();
  return map;
}

Map MapOptimizer::full_map() const {
  return {.gaussians = map(),
          .medium = medium(),
          .light = light_ ? light_->color(/*learn=*/false) : Tensor(),
          .antialiased = options_.antialiased,
          .log_gains = options_.gain_compensation ? gains_.logs() : Tensor(),
          .illumination = illumination_ ? illumination_->logs() : Tensor(),
          .vignetting = vignetting_,
          .tone_curve = tone_curve_};
}

std::optional<medium::Medium> MapOptimizer::medium() const {
  if (!medium_) return std::nullopt;
  const medium::Medium water = medium_->medium();
  return medium::Medium{.beta_d = water.beta_d.detach(),
                        .beta_b = water.beta_b.detach(),
                        .b_inf = water.b_inf.detach(),
                        .lamp = water.lamp};
}

std::optional<double> MapOptimizer::medium_rate() const {
  return medium_ ? std::optional(medium_->rate()) : std::nullopt;
}

void MapOptimizer::save(torch::serialize::OutputArchive& archive) const {
  save_part(archive, "map", shared_->store);
  save_part(archive, "statistics", shared_->statistics);
  save_session(archive);
}

void MapOptimizer::save_session(torch::serialize::OutputArchive& archive) const {
  const auto child = [&archive](const char* name, const auto& part) {
    save_part(archive, name, part);
  };
  child("corrections", corrections_);
  child("gains", gains_);
  if (robust_weights_) child("robust_weights", *robust_weights_);
  child("water", medium_posterior_);
  child("tone_curve_evidence", tone_curve_evidence_);
  child("medium_support", medium_support_);
  if (illumination_) child("illumination", *illumination_);
  if (light_) child("light", *light_);
  archive.write("vignetting_square", torch::IValue(vignetting_.square));
  archive.write("vignetting_fourth", torch::IValue(vignetting_.fourth));
  archive.write("tone_curve", gaussians::to_tensor(tone_curve_));
  if (medium_) child("medium", *medium_);
  archive.write("has_medium", torch::IValue(medium_.has_value()));
}

// Prunes on the host first: the device may not have memory for the saved number of Gaussians.
void MapOptimizer::load(torch::serialize::InputArchive& archive) {
  torch::serialize::InputArchive part;
  archive.read("map", part);
  shared_->store = gaussians::GaussianStore::load(part);
  archive.read("statistics", part);
  shared_->statistics.load(part);
  TORCH_CHECK(shared_->statistics.has_size(size()),
              "checkpoint: density statistics do not match the number of Gaussians");
  prune_least_important(size() - shared_->max_gaussians);
  move_to(gaussians::active_device());
  load_session(archive);
}

void MapOptimizer::load_session(torch::serialize::InputArchive& archive) {
  torch::serialize::InputArchive part;
  archive.read("corrections", part);
  corrections_.load(part);
  archive.read("gains", part);
  gains_.load(part);
  if (robust_weights_) {
    archive.read("robust_weights", part);
    robust_weights_->load(part);
  }
  archive.read("water", part);
  medium_posterior_.load(part);
  archive.read("tone_curve_evidence", part);
  tone_curve_evidence_.load(part);
  archive.read("medium_support", part);
  medium_support_.load(part);
  if (illumination_) {
    archive.read("illumination", part);
    illumination_->load(part);
  }
  if (light_) {
    archive.read("light", part);
    light_->load(part);
  }
  vignetting_ = {.square = gaussians::read_double(archive, "vignetting_square"),
                 .fourth = gaussians::read_double(archive, "vignetting_fourth")};
  Tensor curve;
  archive.read("tone_curve", curve);
  set_tone_curve(gaussians::tone_curve_of(curve));
  falloffs_.clear();
  medium_views_.clear();
  if (!gaussians::read_bool(archive, "has_medium")) return medium_.reset();
  if (!medium_) create_medium(medium::coastal_medium());
  archive.read("medium", part);
  medium_->load(part);
}

}  // namespace apvi::mapping
