// SPDX-License-Identifier: BSD-3-Clause
// GaussianStorage: checkpoints.
#include <torch/torch.h>

#include <algorithm>
#include <memory>
#include <string>
#include <utility>

#include "gaussians/model/archive.hpp"
#include "mapping/storage/detached_gaussians.hpp"
#include "mapping/storage/gaussian_storage.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;
using torch::serialize::InputArchive;
using torch::serialize::OutputArchive;

void write_child(OutputArchive& archive, const std::string& name, OutputArchive child) {
  archive.write(name, child);
}

/// Gaussians with their motions.
OutputArchive archive_of(const DetachedGaussians& detached) {
  OutputArchive archive;
  save(archive, detached);
  if (detached.motions.defined()) {
    archive.write("motions", detached.motions);
    archive.write("which", detached.which);
  }
  return archive;
}

DetachedGaussians with_motions(InputArchive& archive) {
  DetachedGaussians out = load_detached(archive);
  if (archive.try_read("motions", out.motions)) archive.read("which", out.which);
  return out;
}

}  // namespace

StorageFiles GaussianStorage::save(OutputArchive& archive, int present_version) const {
  const torch::NoGradGuard no_grad;
  StorageFiles files;
  std::int64_t versions = 0;
  for (const auto& [version, blocks] : by_version(anchors())) {
    OutputArchive inner;
    inner.write("version", c10::IValue(static_cast<std::int64_t>(version - present_version)));
    save_version(inner, blocks, files);
    archive.write("version" + std::to_string(versions++), inner);
  }
  archive.write("versions", c10::IValue(versions));
  return files;
}

void GaussianStorage::save_version(OutputArchive& archive, const std::vector<const Block*>& blocks,
                                   StorageFiles& files) {
  std::vector<const Block*> in_memory;
  std::vector<DetachedGaussians> parts;
  std::int64_t count = 0;
  for (const Block* block : blocks) {
    if (block->file) {
      write_child(archive, "file" + std::to_string(count++), reference_to(*block));
      files.push_back(block->file);
    } else {
      in_memory.push_back(block);
      parts.push_back(block->gaussians);
    }
  }
  archive.write("files", c10::IValue(count));
  archive.write("has_memory", c10::IValue(!in_memory.empty()));
  if (!in_memory.empty()) {
    write_child(archive, "memory", archive_of(joined(in_memory, std::move(parts))));
  }
  const auto known = [](const Block* block) {
    return known_keyframes(*block->gaussians.appearance);
  };
  const Block* const best =
      *std::max_element(blocks.begin(), blocks.end(),
                        [&](const Block* a, const Block* b) { return known(a) < known(b); });
  OutputArchive appearance;
  save_appearance(appearance, *best->gaussians.appearance);
  archive.write("appearance", appearance);
}

OutputArchive GaussianStorage::reference_to(const Block& block) {
  OutputArchive archive = archive_of(block.gaussians);
  archive.write("name", c10::IValue(block.file->name()));
  archive.write("bytes", c10::IValue(block.file->bytes()));
  archive.write("size", c10::IValue(block.size));
  if (block.motion.defined()) archive.write("motion", block.motion);
  return archive;
}

StorageFiles GaussianStorage::load(InputArchive& archive, int present_version) {
  *this = GaussianStorage(folder_);
  StorageFiles files;
  const std::int64_t versions = gaussians::read_int(archive, "versions");
  for (std::int64_t k = 0; k < versions; ++k) {
    InputArchive inner;
    archive.read("version" + std::to_string(k), inner);
    load_version(inner, present_version, files);
  }
  return files;
}

void GaussianStorage::load_version(InputArchive& archive, int present_version,
                                   StorageFiles& files) {
  InputArchive part;
  archive.read("appearance", part);
  const auto appearance = std::make_shared<const Map>(load_appearance(part));
  const int version = present_version + static_cast<int>(gaussians::read_int(archive, "version"));
  const auto in_appearance = [&](DetachedGaussians detached) {
    detached.appearance = appearance;
    detached.appearance_version = version;
    return detached;
  };
  if (gaussians::read_bool(archive, "has_memory")) {
    archive.read("memory", part);
    add(in_appearance(with_motions(part)));
  }
  const std::int64_t count = gaussians::read_int(archive, "files");
  for (std::int64_t k = 0; k < count; ++k) {
    archive.read("file" + std::to_string(k), part);
    c10::IValue name;
    part.read("name", name);
    files.push_back(folder_->open(name.toStringRef(), gaussians::read_int(part, "bytes")));
    Block block = {.gaussians = in_appearance(load_detached(part)),
                   .size = gaussians::read_int(part, "size"),
                   .file = files.back()};
    part.try_read("motion", block.motion);
    TORCH_CHECK(block.gaussians.rows.size() > 0, "checkpoint: a stored part is empty");
    const auto anchor = block.gaussians.rows.anchors[0].item<std::int64_t>();
    insert(anchor, std::move(block));
  }
  ++version_;
}

}  // namespace apvi::mapping
