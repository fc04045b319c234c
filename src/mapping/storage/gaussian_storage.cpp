// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/storage/gaussian_storage.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cstddef>
#include <utility>

#include "gaussians/model/archive.hpp"
#include "gaussians/model/similarity.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

std::vector<Tensor*> tensors_of(DetachedGaussians& detached) {
  gaussians::GaussianRows& rows = detached.rows;
  std::vector<Tensor*> all = {&rows.anchors, &detached.importance};
  for (gaussians::Gaussians* part : {&rows.parameters, &rows.first, &rows.second}) {
    for (Tensor* tensor : part->tensors()) all.push_back(tensor);
  }
  return all;
}

template <typename Function>
DetachedGaussians map_tensors(DetachedGaussians detached, Function function) {
  for (Tensor* tensor : tensors_of(detached)) *tensor = function(*tensor);
  return detached;
}

std::int64_t known_keyframes(const DetachedGaussians& detached) {
  const Tensor& gains = detached.appearance->log_gains;
  return gains.defined() ? gains.size(0) : 0;
}

/// Of at least one, in the appearance that knows the gains of all their keyframes.
DetachedGaussians concatenated(std::vector<DetachedGaussians> parts) {
  DetachedGaussians out = *std::ranges::max_element(parts, {}, known_keyframes);
  std::vector<std::vector<Tensor>> columns(tensors_of(out).size());
  for (DetachedGaussians& part : parts) {
    const std::vector<Tensor*> tensors = tensors_of(part);
    for (std::size_t k = 0; k < tensors.size(); ++k) columns[k].push_back(*tensors[k]);
  }
  const std::vector<Tensor*> tensors = tensors_of(out);
  for (std::size_t k = 0; k < tensors.size(); ++k) *tensors[k] = torch::cat(columns[k]);
  return out;
}

}  // namespace

void GaussianStorage::add(DetachedGaussians detached) {
  const torch::NoGradGuard no_grad;
  if (detached.motions.defined()) {
    detached.rows.parameters = gaussians::transformed(
        detached.rows.parameters, gaussians::rigid_transforms(detached.motions), detached.which);
    detached.motions = detached.which = Tensor();
  }
  const auto [anchors, order] = at::sort(detached.rows.anchors, c10::optional<bool>(true), 0);
  const DetachedGaussians sorted =
      map_tensors(detached, [&rows = order](const Tensor& t) { return t.index_select(0, rows); });
  const auto [unique, inverse, counts] = at::unique_consecutive(anchors, false, true);
  std::int64_t begin = 0;
  for (std::int64_t k = 0; k < unique.numel(); ++k) {
    const auto count = counts[k].item<std::int64_t>();
    // A copy, so that it does not keep the others in memory.
    Block block = {.gaussians = map_tensors(
                       sorted, [&](const Tensor& t) { return t.narrow(0, begin, count).clone(); }),
                   .motion = {}};
    size_ += count;
    bytes_ += block.gaussians.rows.bytes();
    blocks_[unique[k].item<std::int64_t>()].push_back(std::move(block));
    begin += count;
  }
  ++version_;
}

void GaussianStorage::move(const KeyframeMotions& motions) {
  for (const auto& [anchor, motion] : motions) {
    const auto found = blocks_.find(anchor);
    if (found == blocks_.end()) continue;
    for (Block& block : found->second) {
      block.motion = block.motion.defined() ? motion.matmul(block.motion) : motion.clone();
    }
    ++version_;
  }
}

// The moments are not rotated: they decay within a few steps, and corrections rotate little.
DetachedGaussians GaussianStorage::joined(const std::vector<const Block*>& blocks, int stride) {
  std::vector<DetachedGaussians> parts;
  std::vector<Tensor> motions;
  std::vector<Tensor> which;
  bool moved = false;
  for (const Block* block : blocks) {
    DetachedGaussians part = block->gaussians;
    if (stride > 1) {
      part =
          map_tensors(part, [&](const Tensor& t) { return t.slice(0, 0, c10::nullopt, stride); });
    }
    which.push_back(
        torch::full({part.rows.size()}, static_cast<std::int64_t>(parts.size()), torch::kInt64));
    parts.push_back(std::move(part));
    motions.push_back(block->motion.defined() ? block->motion : torch::eye(4, torch::kFloat64));
    moved |= block->motion.defined();
  }
  DetachedGaussians out = concatenated(std::move(parts));
  if (!moved) return out;
  out.motions = torch::stack(motions);
  out.which = torch::cat(which);
  return out;
}

std::vector<DetachedGaussians> GaussianStorage::read(const std::vector<std::int64_t>& anchors,
                                                     int stride) const {
  const torch::NoGradGuard no_grad;
  std::map<int, std::vector<const Block*>> by_version;
  for (const std::int64_t anchor : anchors) {
    const auto found = blocks_.find(anchor);
    if (found == blocks_.end()) continue;
    for (const Block& block : found->second) {
      by_version[block.gaussians.appearance_version].push_back(&block);
    }
  }
  std::vector<DetachedGaussians> out;
  for (const auto& [version, blocks] : by_version) out.push_back(joined(blocks, stride));
  return out;
}

std::vector<DetachedGaussians> GaussianStorage::take(const std::vector<std::int64_t>& anchors) {
  std::vector<DetachedGaussians> out = read(anchors);
  for (const std::int64_t anchor : anchors) {
    const auto found = blocks_.find(anchor);
    if (found == blocks_.end()) continue;
    for (const Block& block : found->second) {
      size_ -= block.gaussians.rows.size();
      bytes_ -= block.gaussians.rows.bytes();
    }
    blocks_.erase(found);
    ++version_;
  }
  return out;
}

std::vector<std::int64_t> GaussianStorage::anchors() const {
  std::vector<std::int64_t> out;
  for (const auto& [anchor, blocks] : blocks_) out.push_back(anchor);
  return out;
}

std::int64_t GaussianStorage::size(std::int64_t anchor) const {
  const auto found = blocks_.find(anchor);
  std::int64_t sum = 0;
  if (found == blocks_.end()) return sum;
  for (const Block& block : found->second) sum += block.gaussians.rows.size();
  return sum;
}

void save(torch::serialize::OutputArchive& archive, const DetachedGaussians& detached) {
  gaussians::write_gaussians(archive, "", detached.rows.parameters);
  gaussians::write_gaussians(archive, "first.", detached.rows.first);
  gaussians::write_gaussians(archive, "second.", detached.rows.second);
  archive.write("anchors", detached.rows.anchors);
  archive.write("importance", detached.importance);
}

DetachedGaussians load_detached(torch::serialize::InputArchive& archive) {
  DetachedGaussians out;
  out.rows = {.parameters = gaussians::read_gaussians(archive, ""),
              .first = gaussians::read_gaussians(archive, "first."),
              .second = gaussians::read_gaussians(archive, "second."),
              .anchors = {}};
  archive.read("anchors", out.rows.anchors);
  archive.read("importance", out.importance);
  for (const Tensor* tensor : tensors_of(out)) {
    TORCH_CHECK(tensor->size(0) == out.rows.size(), "checkpoint: stored Gaussians do not match");
  }
  return out;
}

}  // namespace apvi::mapping
