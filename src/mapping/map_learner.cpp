// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/map_learner.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "apvi/mapping/open_water.hpp"
#include "apvi/mapping/smooth_depth.hpp"
#include "apvi/mapping/step_backend.hpp"
#include "apvi/splat/device.hpp"
#include "apvi/splat/losses.hpp"
#include "apvi/splat/medium_estimate.hpp"
#include "apvi/splat/morton.hpp"
#include "archive.hpp"
#include "recolor.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr int kGainReduction = 4;  // of the picture that a new view's gain is found with
// What changes slowly is looked after in one of so many steps: a step is as long on a GPU as its
// operators are many, and these have as many as the rest together.
constexpr std::int64_t kGainSteps = 2;
constexpr std::int64_t kWaterSteps = 8;  // once the water is known about
constexpr std::int64_t kReorderSteps = 1000;
constexpr std::int64_t kOpacitySteps = 4;
constexpr std::int64_t kSmoothSteps = 8;
constexpr double kLeastVeil = 1e-3;
constexpr double kMostVeil = 0.98;

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
  return {.beta_d = moved(medium.beta_d),
          .beta_b = moved(medium.beta_b),
          .b_inf = moved(medium.b_inf),
          .lamp = medium.lamp};
}

std::vector<double> seconds_of(const KeyframeStore& keyframes) {
  std::vector<double> seconds(keyframes.size());
  for (std::size_t i = 0; i < seconds.size(); ++i) {
    seconds[i] = 1e-9 * static_cast<double>(keyframes[i].stamp_ns - keyframes[0].stamp_ns);
  }
  return seconds;
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
      corrections_(views, options.poses, options.exposure),
      gains_(views, splat::active_device()) {
  if (medium) medium_.emplace(on_device(*medium));
}

const splat::MediumView& MapLearner::water_before(const splat::Intrinsics& camera) {
  const auto kept = waters_.find(camera.width);
  if (kept != waters_.end()) return kept->second;
  return waters_.emplace(camera.width, splat::MediumView(*medium(), camera)).first->second;
}

bool MapLearner::learns_water() const {
  return medium_ && (!medium_->held() || store_.steps() % kWaterSteps == 0);
}

bool MapLearner::matches_gain(const StepSettings& settings) const {
  return options_.auto_gain && settings.match_gain && store_.steps() % kGainSteps == 0;
}

Tensor MapLearner::step(const KeyframeStore& keyframes, std::size_t i,
                        const StepSettings& settings) {
  splat::View camera = keyframes.view(i, settings.reduction);
  camera.pose_delta = corrections_.pose_delta(i, settings.correct_pose);
  const bool learns = learns_water();
  std::optional<splat::MediumView> learnt;
  if (learns) learnt = water_before(camera.intrinsics).with(medium_->medium());
  const splat::MediumView* const water =
      learns ? &*learnt : (medium_ ? &water_before(camera.intrinsics) : nullptr);
  const splat::RenderOutput out = splat::render(
      store_.view(), camera,
      {.sh_degree = settings.sh_degree,
       .antialiased = options_.antialiased,
       .background = {},
       .light = water ? water->light_on(store_.view().means, camera.T_camera_world) : Tensor(),
       .rows = true});
  const Tensor seen = water ? water->see(out.color, out.depth, out.alpha) : out.color;
  const Tensor image = corrections_.expose(i, seen, /*learn=*/true);
  const bool pulls = water != nullptr && store_.steps() % kOpacitySteps == 0;
  const bool looks_at_water = pulls || (water != nullptr && matches_gain(settings));
  const DrawnView drawn = {.image = image.detach(),
                           .alpha = out.alpha.detach(),
                           .open_water = looks_at_water ? water->open_water() : Tensor(),
                           .horizon = horizon(camera)};
  const Target target = target_of(keyframes, i, drawn, settings);
  Tensor loss = splat::photometric_loss(image, target.raised_to(drawn.image), options_.ssim_weight);
  if (options_.smoothness > 0.0 && store_.steps() % kSmoothSteps == kSmoothSteps / 2) {
    loss = loss + options_.smoothness * bentness(out.depth, drawn.alpha, target.picture);
  }
  if (pulls) {
    const OpacityWeights& weights = water->has_lamp() ? kByLamplight : kByDaylight;
    const Tensor pull =
        opacity_pull(target.raised_to(drawn.open_water), drawn.open_water, drawn.alpha, weights);
    torch::autograd::backward({loss, out.alpha}, {Tensor(), pull});
  } else {
    loss.backward();
  }
  statistics_.observe(out.statistics);
  if (out.rows != nullptr) {
    store_.step(settings.rates, *out.rows, options_.sparse_adam);
  } else {
    store_.step(settings.rates, {}, options_.sparse_adam ? out.statistics.visible : Tensor());
  }
  corrections_.step(i, camera.pose_delta);
  if (learns) {
    medium_->step();
    const splat::Medium now = *medium();
    for (auto& [width, kept] : waters_) kept = kept.with(now);
  }
  return loss.detach();
}

Tensor MapLearner::Target::raised_to(const Tensor& colors) const {
  if (!saturated.defined()) return picture;
  return torch::where(saturated, torch::maximum(picture, colors), picture);
}

MapLearner::Target MapLearner::target_of(const KeyframeStore& keyframes, std::size_t i,
                                         const DrawnView& drawn, const StepSettings& settings) {
  const torch::Device device = drawn.image.device();
  const StepBackend& backend = step_backend(device);
  TargetInput input = {.picture = keyframes[i].image.to(device),
                       .reduction = settings.reduction,
                       .falloff = vignetting_ > 0.0
                                      ? falloff(keyframes.view(i, settings.reduction).intrinsics)
                                      : Tensor(),
                       .log_gain = {}};
  if (options_.auto_gain) {
    if (matches_gain(settings)) gains_.follow(i, drawn, backend.target(input));
    input.log_gain = gains_.log_gain(i);
  }
  Target target = {.picture = backend.target(input), .saturated = {}};
  if (keyframes[i].saturates) {
    target.saturated = backend.saturated(input.picture, input.reduction);
  }
  return target;
}

DensifyResult MapLearner::densify(double extent, std::int64_t limit, std::uint64_t seed,
                                  std::int64_t passed) {
  const DensifyResult result =
      mapping::densify(store_, statistics_, options_.densify, extent, limit, seed);
  statistics_.begin_round();
  // Whether it is time can be told from what checkpoints hold.
  if (store_.steps() % kReorderSteps < passed) reorder();
  return result;
}

void MapLearner::reorder() {
  const Tensor order = splat::morton_order(store_.view().means);
  store_.reorder(order);
  statistics_.reorder(order);
}

void MapLearner::insert(const splat::Gaussians& gaussians, const Tensor& anchors) {
  store_.insert(gaussians, anchors);
  statistics_.extend(gaussians.size());
}

void MapLearner::remove(const Tensor& remove) {
  store_.prune(remove);
  statistics_.keep(remove.logical_not());
}

void MapLearner::drop_least(std::int64_t count, const Tensor& among) {
  if (count <= 0) return;
  Tensor order = statistics_.importance();
  if (among.defined()) order = order.masked_fill(~among, std::numeric_limits<float>::infinity());
  Tensor gone = torch::zeros_like(order, order.options().dtype(torch::kBool));
  gone.index_fill_(0, std::get<1>(order.topk(count, 0, /*largest=*/false)), true);
  remove(gone);
}

void MapLearner::keep_best(std::int64_t most) {
  const torch::NoGradGuard no_grad;
  if (!statistics_.is_of(size())) statistics_ = DensityStatistics(size());
  move_to(torch::kCPU);
  drop_least(size() - most);
  move_to(splat::active_device());
}

void MapLearner::move_to(const torch::Device& device) {
  store_.to(device);
  statistics_.to(device);
}

void MapLearner::move(const std::map<std::int64_t, Tensor>& motions) {
  if (motions.empty()) return;
  // Which motion an anchor has, by its number; the first is of all that stay.
  std::vector<std::int64_t> which(2 + static_cast<std::size_t>(motions.rbegin()->first), -1);
  std::vector<Tensor> each;
  for (const auto& [anchor, motion] : motions) {
    which[1 + static_cast<std::size_t>(anchor)] = static_cast<std::int64_t>(each.size());
    each.push_back(motion);
  }
  const Tensor anchors = store_.anchors();
  const auto last = static_cast<std::int64_t>(which.size()) - 1;
  const Tensor known = torch::tensor(which, torch::kInt64).to(anchors.device());
  const Tensor of = known.index_select(0, torch::where(anchors < last, anchors + 1, 0));
  store_.transform(splat::rigid_motions(torch::stack(each)), of);
}

void MapLearner::add_view() {
  corrections_.add_view();
  gains_.add_view();
}

Tensor MapLearner::falloff(const splat::Intrinsics& camera) {
  Tensor& kept = falloffs_[camera.width];
  if (!kept.defined()) kept = lens_falloff(camera, vignetting_, splat::active_device());
  return kept;
}

void MapLearner::match_gain(const KeyframeStore& keyframes, std::size_t i) {
  if (!options_.auto_gain || size() == 0) return;
  const torch::NoGradGuard no_grad;
  const splat::View camera = keyframes.view(i, kGainReduction);
  const Picture drawn = take_picture(whole_map(), camera);
  const Tensor picture =
      step_backend(drawn.alpha.device())
          .target({.picture = keyframes[i].image.to(drawn.alpha.device()),
                   .reduction = kGainReduction,
                   .falloff = vignetting_ > 0.0 ? falloff(camera.intrinsics) : Tensor(),
                   .log_gain = {}});
  gains_.find(i,
              {.image = drawn.as_seen,
               .alpha = drawn.alpha,
               .open_water = medium_ ? water_before(camera.intrinsics).open_water() : Tensor(),
               .horizon = horizon(camera)},
              picture);
}

void MapLearner::adopt(const splat::Medium& medium, const Tensor& known,
                       const KeyframeStore& keyframes) {
  const torch::NoGradGuard no_grad;
  Map after = whole_map();
  after.medium = medium;
  wear(after, known, keyframes);
}

void MapLearner::adopt(const WaterSurvey& survey, const KeyframeStore& keyframes) {
  const torch::NoGradGuard no_grad;
  Map after = whole_map();
  splat::Medium water = survey.fit.medium;
  surveys_ = survey.fit.surveys;
  if (options_.auto_gain) {
    const Tensor logs = surveyed_gains(gains_.logs().to(torch::kCPU, torch::kFloat64),
                                       seconds_of(keyframes), survey.views, survey.fit.log_gains);
    const auto& views = keyframes.training();
    const double median =
        logs.index_select(0, torch::tensor(std::vector<std::int64_t>(views.begin(), views.end()),
                                           torch::kInt64))
            .median()
            .item<double>();
    after.log_gains = (logs - median).to(gains_.logs().options());
    water.b_inf = water.b_inf * std::exp(median);
    if (water.lamp) water.lamp->glow = water.lamp->glow * std::exp(median);
  }
  water.b_inf =
      surveys_.add_veil(water.b_inf.log(), survey.fit.sigmas.select(1, 2), survey.sees_open_water)
          .exp()
          .clamp(kLeastVeil, kMostVeil);
  after.vignetting = survey.fit.vignetting;
  after.medium = water;
  wear(after, survey.fit.known, keyframes);
}

void MapLearner::wear(const Map& after, const Tensor& known, const KeyframeStore& keyframes) {
  recolor(whole_map(), after, keyframes);
  if (options_.auto_gain) gains_.set_logs(after.log_gains);
  vignetting_ = after.vignetting;
  falloffs_.clear();
  if (!medium_) medium_.emplace(on_device(*after.medium));
  medium_->hold(*after.medium, known);
  waters_.clear();
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

Map MapLearner::whole_map() const {
  return {.gaussians = map(),
          .medium = medium(),
          .antialiased = options_.antialiased,
          .log_gains = options_.auto_gain ? gains_.logs() : Tensor(),
          .vignetting = vignetting_};
}

std::optional<splat::Medium> MapLearner::medium() const {
  if (!medium_) return std::nullopt;
  const splat::Medium water = medium_->medium();
  return splat::Medium{.beta_d = water.beta_d.detach(),
                       .beta_b = water.beta_b.detach(),
                       .b_inf = water.b_inf.detach(),
                       .lamp = water.lamp};
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
  child("gains", gains_);
  child("water", surveys_);
  archive.write("vignetting", torch::IValue(vignetting_));
  if (medium_) child("medium", *medium_);
  archive.write("has_medium", torch::IValue(medium_.has_value()));
}

// On the host first: the device may have no memory for more than is to stay.
void MapLearner::load(torch::serialize::InputArchive& archive) {
  torch::serialize::InputArchive part;
  archive.read("map", part);
  store_ = splat::GaussianStore::load(part);
  archive.read("statistics", part);
  statistics_.load(part);
  TORCH_CHECK(statistics_.is_of(size()), "the archive's statistics do not fit its Gaussians");
  drop_least(size() - options_.densify.max_gaussians);
  move_to(splat::active_device());
  archive.read("corrections", part);
  corrections_.load(part);
  archive.read("gains", part);
  gains_.load(part);
  archive.read("water", part);
  surveys_.load(part);
  vignetting_ = read_double(archive, "vignetting");
  falloffs_.clear();
  waters_.clear();
  if (!read_bool(archive, "has_medium")) return medium_.reset();
  if (!medium_) medium_.emplace(on_device(splat::coastal_medium()));
  archive.read("medium", part);
  medium_->load(part);
}

}  // namespace apvi::mapping
