// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/alignment/frozen_reference_map.hpp"

#include <torch/torch.h>

#include <array>
#include <cstddef>
#include <utility>

#include "gaussians/model/archive.hpp"
#include "gaussians/model/similarity.hpp"
#include "gaussians/render/render.hpp"
#include "mapping/density/seeds.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kCoveredAlpha = 0.5;

constexpr std::array<const char*, 6> kNames = {"means",           "log_scales", "quaternions",
                                               "logit_opacities", "sh_dc",      "sh_rest"};

/// Indices of the `means` [n,3] that project to pixels not covered by `known`.
Tensor uncovered(const gaussians::Gaussians& known, const Tensor& means,
                 const gaussians::View& camera) {
  const ProjectedPoints seen = project(camera, means.to(torch::kCPU, torch::kFloat64));
  Tensor selected = seen.in_view;
  if (known.size() > 0) {
    const Tensor alpha = gaussians::render(known, camera, {}).alpha.to(torch::kCPU).flatten();
    const Tensor pixels = pixel_index(camera.intrinsics, seen.pixels);
    selected = selected & (alpha.index_select(0, pixels) < kCoveredAlpha);
  }
  return selected.nonzero().squeeze(1).to(means.device());
}

}  // namespace

// Gaussians inserted recently do not count as covered: a new area spans several keyframes.
gaussians::Gaussians FrozenReferenceMap::older_than(std::int64_t stamp_ns) const {
  gaussians::Gaussians known;
  if (gaussians_.size() == 0) return known;
  const std::int64_t count = (stamps_ < stamp_ns).sum().item<std::int64_t>();
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    *known.tensors()[k] = gaussians_.tensors()[k]->slice(0, 0, count);
  }
  return known;
}

void FrozenReferenceMap::insert(const gaussians::Gaussians& gaussians,
                                const gaussians::View& camera, std::int64_t stamp_ns) {
  const torch::NoGradGuard no_grad;
  if (gaussians.size() == 0) return;
  const Tensor which = uncovered(older_than(stamp_ns - kReferenceAge_ns), gaussians.means, camera);
  const bool first = gaussians_.size() == 0;
  gaussians::Gaussians all;  // members are unchanged when an allocation throws
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    Tensor part = gaussians.tensors()[k]->index_select(0, which);
    if (k + 1 == kNames.size()) part = part.slice(1, 0, 0).contiguous();
    Tensor& kept = *all.tensors()[k];
    kept = first ? part : torch::cat({*gaussians_.tensors()[k], part});
    if (kept.size(0) > max_gaussians_) kept = kept.slice(0, kept.size(0) - max_gaussians_).clone();
  }
  gaussians_ = std::move(all);
  stamps_ = torch::cat({stamps_, torch::full({which.size(0)}, stamp_ns, torch::kInt64)});
  if (stamps_.size(0) > max_gaussians_) {
    stamps_ = stamps_.slice(0, stamps_.size(0) - max_gaussians_).clone();
  }
}

void FrozenReferenceMap::move(std::int64_t stamp_ns, const Tensor& motion) {
  const torch::NoGradGuard no_grad;
  const std::int64_t begin = (stamps_ < stamp_ns).sum().item<std::int64_t>();
  const std::int64_t count = (stamps_ == stamp_ns).sum().item<std::int64_t>();
  if (count == 0) return;
  gaussians::Gaussians own;
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    *own.tensors()[k] = gaussians_.tensors()[k]->slice(0, begin, begin + count);
  }
  const gaussians::Gaussians transformed =
      gaussians::transformed(own, gaussians::rigid_transforms(motion.unsqueeze(0)));
  for (std::size_t k = 0; k < kNames.size(); ++k)
    own.tensors()[k]->copy_(*transformed.tensors()[k]);
}

void FrozenReferenceMap::change_scale(const gaussians::ScaleChange& change) {
  const torch::NoGradGuard no_grad;
  if (gaussians_.size() == 0) return;
  gaussians_ = gaussians::transformed(gaussians_, gaussians::scaling(change));
}

void FrozenReferenceMap::save(torch::serialize::OutputArchive& archive) const {
  archive.write("stamps", stamps_);
  archive.write("any", c10::IValue(gaussians_.size() > 0));
  if (gaussians_.size() == 0) return;
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    archive.write(kNames[k], *gaussians_.tensors()[k]);
  }
}

void FrozenReferenceMap::load(torch::serialize::InputArchive& archive,
                              const torch::Device& device) {
  gaussians_ = {};
  archive.read("stamps", stamps_);
  if (!gaussians::read_bool(archive, "any")) return;
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    Tensor read;
    archive.read(kNames[k], read);
    *gaussians_.tensors()[k] = read.to(device);
  }
}

}  // namespace apvi::mapping
