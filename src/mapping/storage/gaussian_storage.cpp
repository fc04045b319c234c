// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/storage/gaussian_storage.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cstddef>
#include <utility>

#include "gaussians/model/archive.hpp"
#include "gaussians/model/similarity.hpp"
#include "mapping/storage/detached_gaussians.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

/// Of at least one, in the appearance that knows the gains of all their keyframes.
DetachedGaussians concatenated(std::vector<DetachedGaussians> parts) {
  const auto known = [](const DetachedGaussians& part) {
    return known_keyframes(*part.appearance);
  };
  DetachedGaussians out =
      *std::max_element(parts.begin(), parts.end(),
                        [&](const auto& a, const auto& b) { return known(a) < known(b); });
  std::vector<std::vector<Tensor>> columns(tensors_of(out).size());
  for (DetachedGaussians& part : parts) {
    const std::vector<Tensor*> tensors = tensors_of(part);
    for (std::size_t k = 0; k < tensors.size(); ++k) columns[k].push_back(*tensors[k]);
  }
  const std::vector<Tensor*> tensors = tensors_of(out);
  for (std::size_t k = 0; k < tensors.size(); ++k) *tensors[k] = torch::cat(columns[k]);
  return out;
}

// A copy, so that it does not keep all of them in memory.
DetachedGaussians thinned(const DetachedGaussians& detached, int stride) {
  return map_tensors(detached,
                     [&](const Tensor& t) { return t.slice(0, 0, c10::nullopt, stride).clone(); });
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
    const auto part = [&](const Tensor& t) { return t.narrow(0, begin, count).clone(); };
    insert(unique[k].item<std::int64_t>(), {.gaussians = map_tensors(sorted, part), .size = count});
    begin += count;
  }
  ++version_;
}

void GaussianStorage::insert(std::int64_t anchor, Block block) {
  size_ += block.size;
  bytes_ += block.gaussians.rows.bytes();
  blocks_[anchor].push_back(std::move(block));
}

void GaussianStorage::write(const std::vector<std::int64_t>& anchors, double max_bytes) {
  const torch::NoGradGuard no_grad;
  for (const std::int64_t anchor : anchors) {
    for (Block& block : blocks_.at(anchor)) {
      if (static_cast<double>(bytes_) <= max_bytes) return;
      if (!block.file && !write(block)) return;
    }
  }
}

bool GaussianStorage::write(Block& block) {
  torch::serialize::OutputArchive archive;
  mapping::save(archive, block.gaussians);
  const std::int64_t bytes = block.gaussians.rows.bytes();
  block.file = folder_->write(archive, bytes);
  if (!block.file) return false;
  block.gaussians = thinned(block.gaussians, kSampleStride);
  bytes_ += block.gaussians.rows.bytes() - bytes;
  return true;
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

// All of the block; none when its file is lost.
DetachedGaussians GaussianStorage::content(const Block& block) {
  if (!block.file) return block.gaussians;
  DetachedGaussians out = block.gaussians;
  const bool is_read = block.file->read([&](torch::serialize::InputArchive& archive) {
    out.rows = load_detached(archive).rows;
    archive.read("importance", out.importance);
  });
  const auto nothing = [](const Tensor& t) { return t.narrow(0, 0, 0); };
  return is_read ? out : map_tensors(block.gaussians, nothing);
}

// The moments are not rotated: they decay within a few steps, and corrections rotate little.
DetachedGaussians GaussianStorage::joined(const std::vector<const Block*>& blocks,
                                          std::vector<DetachedGaussians> parts) {
  std::vector<Tensor> motions;
  std::vector<Tensor> which;
  bool moved = false;
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    const Tensor& motion = blocks[k]->motion;
    which.push_back(
        torch::full({parts[k].rows.size()}, static_cast<std::int64_t>(k), torch::kInt64));
    motions.push_back(motion.defined() ? motion : torch::eye(4, torch::kFloat64));
    moved |= motion.defined();
  }
  DetachedGaussians out = concatenated(std::move(parts));
  if (!moved) return out;
  out.motions = torch::stack(motions);
  out.which = torch::cat(which);
  return out;
}

GaussianStorage::BlocksByVersion GaussianStorage::by_version(
    const std::vector<std::int64_t>& anchors) const {
  BlocksByVersion out;
  for (const std::int64_t anchor : anchors) {
    const auto found = blocks_.find(anchor);
    if (found == blocks_.end()) continue;
    for (const Block& block : found->second) {
      out[block.gaussians.appearance_version].push_back(&block);
    }
  }
  return out;
}

std::vector<DetachedGaussians> GaussianStorage::read(
    const std::vector<std::int64_t>& anchors) const {
  const torch::NoGradGuard no_grad;
  std::vector<DetachedGaussians> out;
  for (const auto& [version, blocks] : by_version(anchors)) {
    std::vector<DetachedGaussians> parts;
    for (const Block* block : blocks) parts.push_back(content(*block));
    out.push_back(joined(blocks, std::move(parts)));
  }
  return out;
}

std::vector<DetachedGaussians> GaussianStorage::sample() const {
  const torch::NoGradGuard no_grad;
  std::vector<DetachedGaussians> out;
  for (const auto& [version, blocks] : by_version(anchors())) {
    std::vector<DetachedGaussians> parts;
    for (const Block* block : blocks) {
      parts.push_back(block->file ? block->gaussians : thinned(block->gaussians, kSampleStride));
    }
    out.push_back(joined(blocks, std::move(parts)));
  }
  return out;
}

std::vector<DetachedGaussians> GaussianStorage::take(const std::vector<std::int64_t>& anchors) {
  std::vector<DetachedGaussians> out = read(anchors);
  for (const std::int64_t anchor : anchors) {
    const auto found = blocks_.find(anchor);
    if (found == blocks_.end()) continue;
    for (const Block& block : found->second) {
      size_ -= block.size;
      bytes_ -= block.gaussians.rows.bytes();
    }
    blocks_.erase(found);
    ++version_;
  }
  return out;
}

bool GaussianStorage::has_room(double max_bytes) const {
  return static_cast<double>(bytes_) < max_bytes || folder_->has_room();
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
  for (const Block& block : found->second) sum += block.size;
  return sum;
}

}  // namespace apvi::mapping
