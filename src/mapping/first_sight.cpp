// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/first_sight.hpp"

#include <torch/torch.h>

#include <array>
#include <cstddef>
#include <utility>

#include "apvi/mapping/seeds.hpp"
#include "apvi/splat/render.hpp"
#include "apvi/splat/similarity.hpp"
#include "archive.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kKnown = 0.5;  // alpha

constexpr std::array<const char*, 6> kNames = {"means",           "log_scales", "quaternions",
                                               "logit_opacities", "sh_dc",      "sh_rest"};

/// Which of `means` [n,3] stand in the picture where `known` draws nothing: indices.
Tensor unknown(const splat::Gaussians& known, const Tensor& means, const splat::View& camera) {
  const SeenPoints seen = project(camera, means.to(torch::kCPU, torch::kFloat64));
  Tensor fresh = seen.in_view;
  if (known.size() > 0) {
    const Tensor alpha = splat::render(known, camera, {}).alpha.to(torch::kCPU).flatten();
    const Tensor pixels = pixel_index(camera.intrinsics, seen.pixels);
    fresh = fresh & (alpha.index_select(0, pixels) < kKnown);
  }
  return fresh.nonzero().squeeze(1).to(means.device());
}

}  // namespace

// What is in the middle of being seen for the first time is of several keyframes.
splat::Gaussians FirstSight::before(std::int64_t stamp_ns) const {
  splat::Gaussians known;
  if (kept_.size() == 0) return known;
  const std::int64_t count = (stamps_ < stamp_ns).sum().item<std::int64_t>();
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    *known.tensors()[k] = kept_.tensors()[k]->slice(0, 0, count);
  }
  return known;
}

void FirstSight::remember(const splat::Gaussians& gaussians, const splat::View& camera,
                          std::int64_t stamp_ns) {
  const torch::NoGradGuard no_grad;
  if (gaussians.size() == 0) return;
  const Tensor which = unknown(before(stamp_ns - kLongAgo_ns), gaussians.means, camera);
  const bool first = kept_.size() == 0;
  splat::Gaussians all;  // first, because memory may end on the way
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    Tensor part = gaussians.tensors()[k]->index_select(0, which);
    if (k + 1 == kNames.size()) part = part.slice(1, 0, 0).contiguous();
    Tensor& kept = *all.tensors()[k];
    kept = first ? part : torch::cat({*kept_.tensors()[k], part});
    if (kept.size(0) > most_) kept = kept.slice(0, kept.size(0) - most_).clone();
  }
  kept_ = std::move(all);
  stamps_ = torch::cat({stamps_, torch::full({which.size(0)}, stamp_ns, torch::kInt64)});
  if (stamps_.size(0) > most_) stamps_ = stamps_.slice(0, stamps_.size(0) - most_).clone();
}

void FirstSight::move(std::int64_t stamp_ns, const Tensor& motion) {
  const torch::NoGradGuard no_grad;
  const std::int64_t begin = (stamps_ < stamp_ns).sum().item<std::int64_t>();
  const std::int64_t count = (stamps_ == stamp_ns).sum().item<std::int64_t>();
  if (count == 0) return;
  splat::Gaussians own;
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    *own.tensors()[k] = kept_.tensors()[k]->slice(0, begin, begin + count);
  }
  const splat::Gaussians there = splat::transformed(own, splat::rigid_motions(motion.unsqueeze(0)));
  for (std::size_t k = 0; k < kNames.size(); ++k) own.tensors()[k]->copy_(*there.tensors()[k]);
}

void FirstSight::save(torch::serialize::OutputArchive& archive) const {
  archive.write("stamps", stamps_);
  archive.write("any", c10::IValue(kept_.size() > 0));
  if (kept_.size() == 0) return;
  for (std::size_t k = 0; k < kNames.size(); ++k) archive.write(kNames[k], *kept_.tensors()[k]);
}

void FirstSight::load(torch::serialize::InputArchive& archive, const torch::Device& device) {
  kept_ = {};
  archive.read("stamps", stamps_);
  if (!read_bool(archive, "any")) return;
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    Tensor read;
    archive.read(kNames[k], read);
    *kept_.tensors()[k] = read.to(device);
  }
}

}  // namespace apvi::mapping
