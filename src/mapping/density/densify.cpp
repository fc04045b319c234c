// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/densify.hpp"

#include <ATen/CPUGeneratorImpl.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "gaussians/model/rows.hpp"
#include "mapping/training/step_backend.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kSplitShrink = 1.6;
constexpr double kImportanceDecay = 0.98;  // per view with a lower weight
constexpr double kMinViews = 2.0;          // required before pruning by weight

// Rotates vectors [N,3] by quaternions [N,4], not necessarily normalized.
Tensor rotate_vectors(const Tensor& quaternions, const Tensor& vectors) {
  const Tensor q = quaternions / quaternions.norm(2, 1, true);
  const Tensor w = q.slice(1, 0, 1);
  const Tensor v = q.slice(1, 1, 4);
  const Tensor t = 2.0 * torch::cross(v, vectors, 1);
  return vectors + w * t + torch::cross(v, t, 1);
}

// Opacity logit of two clones with the same total transmittance as the original.
Tensor clone_logit(const Tensor& logit) {
  const Tensor opacity = (1.0 - torch::sqrt(1.0 - logit.sigmoid())).clamp(1e-6, 1.0 - 1e-6);
  return torch::log(opacity / (1.0 - opacity));
}

gaussians::Gaussians split_children(const gaussians::Gaussians& parents, std::uint64_t seed) {
  gaussians::Gaussians children = gaussians::join(parents, parents);
  auto generator = at::detail::createCPUGenerator(seed);
  const Tensor noise =
      torch::randn(children.means.sizes(), generator, torch::kFloat32).to(children.means.options());
  children.means =
      children.means + rotate_vectors(children.quaternions, noise * children.log_scales.exp());
  children.log_scales = children.log_scales - std::log(kSplitShrink);
  return children;
}

// Gaussians to densify; those with the largest gradients when there is not room for all.
Tensor growth_mask(const Tensor& gradient, double threshold, std::int64_t room) {
  Tensor candidates = gradient > threshold;
  const auto count = candidates.sum().item<std::int64_t>();
  if (count <= room) return candidates;
  Tensor selected = torch::zeros_like(candidates);
  if (room <= 0) return selected;
  selected.index_fill_(0, std::get<1>(gradient.topk(room)), true);
  return selected;
}

}  // namespace

DensityStatistics::DensityStatistics(std::int64_t count, const torch::Device& device)
    : gradient_sum_(torch::zeros({count}, device)),
      views_(torch::zeros({count}, device)),
      max_weight_(torch::zeros({count}, device)),
      importance_(torch::ones({count}, device)) {}

bool DensityStatistics::has_size(std::int64_t count) const {
  const auto sizes = {gradient_sum_.size(0), views_.size(0), max_weight_.size(0),
                      importance_.size(0)};
  return std::all_of(sizes.begin(), sizes.end(), [count](std::int64_t n) { return n == count; });
}

void DensityStatistics::to(const torch::Device& device) {
  for (Tensor* t : {&gradient_sum_, &views_, &max_weight_, &importance_}) *t = t->to(device);
}

Tensor DensityStatistics::importance() const {
  const torch::NoGradGuard no_grad;
  return torch::maximum(importance_ * torch::pow(kImportanceDecay, views_), max_weight_);
}

void DensityStatistics::begin_round() {
  const torch::NoGradGuard no_grad;
  importance_ = importance();
  for (Tensor* t : {&gradient_sum_, &views_, &max_weight_}) t->zero_();
}

void DensityStatistics::observe(const gaussians::RenderStatistics& statistics) {
  step_backend(views_.device())
      .observe(statistics, {.gradient = gradient_sum_, .views = views_, .max_weight = max_weight_});
}

void DensityStatistics::extend(std::int64_t count, const Tensor& importance) {
  for (Tensor* t : {&gradient_sum_, &views_, &max_weight_}) {
    *t = torch::cat({*t, torch::zeros({count}, t->options())});
  }
  const Tensor added = importance.defined() ? importance.to(importance_.options())
                                            : torch::ones({count}, importance_.options());
  importance_ = torch::cat({importance_, added});
}

void DensityStatistics::keep(const Tensor& which) {
  for (Tensor* t : {&gradient_sum_, &views_, &max_weight_, &importance_}) *t = t->index({which});
}

void DensityStatistics::reorder(const Tensor& order) {
  for (Tensor* t : {&gradient_sum_, &views_, &max_weight_, &importance_}) {
    *t = t->index_select(0, order);
  }
}

void DensityStatistics::save(torch::serialize::OutputArchive& archive) const {
  archive.write("gradient_sum", gradient_sum_, true);
  archive.write("views", views_, true);
  archive.write("max_weight", max_weight_, true);
  archive.write("importance", importance_, true);
}

void DensityStatistics::load(torch::serialize::InputArchive& archive) {
  const auto read = [&](const char* name) {
    Tensor values;
    archive.read(name, values, true);
    return values.to(torch::kCPU);
  };
  gradient_sum_ = read("gradient_sum");
  views_ = read("views");
  max_weight_ = read("max_weight");
  importance_ = read("importance");
}

Tensor prune_mask(const gaussians::Gaussians& gaussians, const DensityStatistics& statistics,
                  const DensifyOptions& options, double extent) {
  const Tensor transparent = gaussians.logit_opacities.sigmoid() < options.prune_opacity;
  const Tensor unused =
      (statistics.views() >= kMinViews) & (statistics.max_weight() < options.prune_weight);
  const Tensor large = std::get<0>(gaussians.log_scales.max(1)) >
                       std::log(std::max(1e-12, options.prune_scale * extent));
  return transparent | unused | large;
}

DensifyResult densify(gaussians::GaussianStore& store, DensityStatistics& statistics,
                      const DensifyOptions& options, double extent, std::int64_t limit,
                      std::uint64_t seed) {
  const torch::NoGradGuard no_grad;
  gaussians::Gaussians map;
  for (std::size_t i = 0; i < map.tensors().size(); ++i) {
    *map.tensors()[i] = store.view().tensors()[i]->detach();
  }
  const Tensor prunable = prune_mask(map, statistics, options, extent);
  const auto pruned = prunable.sum().item<std::int64_t>();
  const Tensor gradient = statistics.mean_gradient().masked_fill(prunable, 0.0);
  const Tensor grow =
      growth_mask(gradient, options.gradient_threshold, limit - (store.size() - pruned));
  const double dense = std::log(options.split_scale * extent);
  const Tensor small = std::get<0>(map.log_scales.max(1)) <= dense;
  const Tensor cloned = (grow & small).nonzero().squeeze(1);
  const Tensor split = grow & ~small;
  const Tensor split_index = split.nonzero().squeeze(1);

  const Tensor clone_logits = clone_logit(map.logit_opacities.index_select(0, cloned));
  map.logit_opacities.index_copy_(0, cloned, clone_logits);
  const Tensor parents = torch::cat({cloned, split_index, split_index});
  store.insert(gaussians::join(gaussians::select(map, cloned),
                               split_children(gaussians::select(map, split_index), seed)),
               store.anchors().index_select(0, parents));
  const Tensor removed = prunable | split;
  const Tensor remove =
      torch::cat({removed, torch::zeros({store.size() - removed.size(0)}, removed.options())});
  store.prune(remove);
  statistics.extend(parents.size(0));
  statistics.keep(remove.logical_not());
  return {.cloned = cloned.size(0), .split = split_index.size(0), .pruned = pruned};
}

}  // namespace apvi::mapping
