// SPDX-License-Identifier: BSD-3-Clause
// Parts of the map of a MapOptimizer that are kept elsewhere.
#include <torch/torch.h>

#include "gaussians/device.hpp"
#include "gaussians/model/similarity.hpp"
#include "mapping/appearance/recolor.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

medium::Medium cloned(const medium::Medium& medium) {
  return {.beta_d = medium.beta_d.clone(),
          .beta_b = medium.beta_b.clone(),
          .b_inf = medium.b_inf.clone(),
          .lamp = medium.lamp};
}

gaussians::Gaussians copied(const gaussians::Gaussians& gaussians, const torch::Device& device) {
  gaussians::Gaussians copy;
  for (std::size_t k = 0; k < copy.tensors().size(); ++k) {
    const Tensor& from = *gaussians.tensors()[k];
    *copy.tensors()[k] = from.to(device, from.scalar_type(), /*non_blocking=*/false, /*copy=*/true);
  }
  return copy;
}

}  // namespace

DetachedGaussians MapOptimizer::detach(const Tensor& which) {
  const torch::NoGradGuard no_grad;
  DetachedGaussians out = {
      .rows = {},
      .importance = shared_->statistics.importance().index({which}).to(torch::kCPU),
      .appearance = std::make_shared<const Map>(appearance()),
      .appearance_version = shared_->appearance_version};
  out.rows = shared_->store.take(which);
  shared_->statistics.keep(which.logical_not());
  shared_->detached += out.rows.size();
  return out;
}

void MapOptimizer::adopt(std::int64_t detached) {
  shared_->detached += detached;
}

void MapOptimizer::attach(const DetachedGaussians& detached, const KeyframeStore& keyframes) {
  const torch::NoGradGuard no_grad;
  gaussians::GaussianRows rows = detached.rows;
  rows.parameters = in_present_colors(detached, keyframes);
  shared_->store.put(rows);
  shared_->statistics.extend(rows.size(), detached.importance);
  shared_->detached -= rows.size();
}

// A copy that the optimizer does not change.
Map MapOptimizer::appearance() const {
  Map copy = full_map();
  copy.gaussians = {};
  copy.illumination = Tensor();
  if (copy.log_gains.defined()) copy.log_gains = copy.log_gains.clone();
  if (copy.medium) copy.medium = cloned(*copy.medium);
  return copy;
}

gaussians::Gaussians MapOptimizer::in_present_colors(const DetachedGaussians& detached,
                                                     const KeyframeStore& keyframes) const {
  const torch::NoGradGuard no_grad;
  Map before = *detached.appearance;
  before.gaussians = copied(detached.rows.parameters, gaussians::active_device());
  if (detached.motions.defined()) {
    before.gaussians = gaussians::transformed(
        before.gaussians, gaussians::rigid_transforms(detached.motions), detached.which);
  }
  if (detached.appearance_version != shared_->appearance_version) {
    recolor(before, full_map(), keyframes, anchor_views(detached.rows.anchors, keyframes));
  }
  return before.gaussians;
}

}  // namespace apvi::mapping
