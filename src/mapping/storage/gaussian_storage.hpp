// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "mapping/alignment/keyframe_poses.hpp"
#include "mapping/storage/storage_folder.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// The Gaussians of a map that are not on the device, in host memory or in files, by the keyframe
/// that they are anchored to. Corrections of keyframes are noted here and applied when Gaussians
/// are read, so that they cost the same however many there are.
///
/// What is in files that are lost or damaged is left out when it is read, with a warning.
class GaussianStorage {
 public:
  /// Of Gaussians in files, every n-th is in memory as well, for `sample`.
  static constexpr int kSampleStride = 8;

  explicit GaussianStorage(std::shared_ptr<StorageFolder> folder) : folder_(std::move(folder)) {}

  void add(DetachedGaussians detached);
  /// Writes the Gaussians of keyframes to files, in this order, until at most `max_bytes` are in
  /// memory or there is no room for files.
  void write(const std::vector<std::int64_t>& anchors, double max_bytes);
  /// Moves the Gaussians of each keyframe.
  void move(const KeyframeMotions& motions);
  /// Counts changes by `add`, `take` and `move`.
  std::int64_t version() const { return version_; }
  /// Removes the Gaussians of these keyframes and returns them, moved; those of the same appearance
  /// together.
  std::vector<DetachedGaussians> take(const std::vector<std::int64_t>& anchors);
  /// The same without removing them.
  std::vector<DetachedGaussians> read(const std::vector<std::int64_t>& anchors) const;
  /// About every n-th Gaussian of all (kSampleStride), without reading files.
  std::vector<DetachedGaussians> sample() const;

  bool holds(std::int64_t anchor) const { return blocks_.count(anchor) != 0; }
  /// Whether there is room for more, in `max_bytes` of memory or in files.
  bool has_room(double max_bytes) const;
  std::vector<std::int64_t> anchors() const;
  std::int64_t size() const { return size_; }
  /// Of the Gaussians of one keyframe; 0 when it has none here.
  std::int64_t size(std::int64_t anchor) const;
  /// In memory.
  std::int64_t bytes() const { return bytes_; }

  /// Saves all, and returns the files that the archive refers to. `present_version` is that of the
  /// appearance of the map.
  StorageFiles save(torch::serialize::OutputArchive& archive, int present_version) const;
  /// Replaces all. Returns the files referred to. Throws c10::Error when tensors do not match.
  StorageFiles load(torch::serialize::InputArchive& archive, int present_version);

 private:
  /// Gaussians of a keyframe that were stored at the same time.
  struct Block {
    DetachedGaussians gaussians;  ///< a sample of them when there is a file
    std::int64_t size = 0;
    torch::Tensor motion = {};  ///< [4,4] float64 since it was stored; undefined: none
    std::shared_ptr<StorageFile> file = {};
  };
  using BlocksByVersion = std::map<int, std::vector<const Block*>>;

  static DetachedGaussians joined(const std::vector<const Block*>& blocks,
                                  std::vector<DetachedGaussians> parts);
  static DetachedGaussians content(const Block& block);
  BlocksByVersion by_version(const std::vector<std::int64_t>& anchors) const;
  static void save_version(torch::serialize::OutputArchive& archive,
                           const std::vector<const Block*>& blocks, StorageFiles& files);
  static torch::serialize::OutputArchive reference_to(const Block& block);
  bool write(Block& block);
  void load_version(torch::serialize::InputArchive& archive, int present_version,
                    StorageFiles& files);
  void insert(std::int64_t anchor, Block block);

  std::shared_ptr<StorageFolder> folder_;
  std::map<std::int64_t, std::vector<Block>> blocks_;
  std::int64_t size_ = 0;
  std::int64_t bytes_ = 0;
  std::int64_t version_ = 0;
};

}  // namespace apvi::mapping
