// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// A file of a StorageFolder. Its last owner deletes it, unless a checkpoint needs it.
class StorageFile {
 public:
  StorageFile(std::filesystem::path path, std::int64_t bytes,
              std::shared_ptr<std::atomic<std::int64_t>> used);
  ~StorageFile();
  StorageFile(const StorageFile&) = delete;
  StorageFile& operator=(const StorageFile&) = delete;

  std::string name() const { return path_.filename().string(); }
  std::int64_t bytes() const { return bytes_; }
  /// Reads the content. Returns false, after a warning, when the file is lost or damaged.
  bool read(const std::function<void(torch::serialize::InputArchive&)>& read) const;
  /// Whether the file outlives its owners.
  void keep(bool kept) { kept_ = kept; }

 private:
  std::filesystem::path path_;
  std::int64_t bytes_ = 0;
  std::shared_ptr<std::atomic<std::int64_t>> used_;
  std::atomic<bool> kept_ = false;
};

using StorageFiles = std::vector<std::shared_ptr<StorageFile>>;

/// Holds on disk what a map has no memory for. All functions may be called from several threads.
class StorageFolder {
 public:
  /// The folder is created with its first file, and deleted if none is left at the end. At most
  /// `max_bytes`; an empty path: nothing.
  StorageFolder(std::filesystem::path folder, double max_bytes);
  ~StorageFolder();
  StorageFolder(const StorageFolder&) = delete;
  StorageFolder& operator=(const StorageFolder&) = delete;

  /// Whether files can be written. Not after a write has failed.
  bool has_room() const;
  /// Writes an archive with about `bytes` of tensors. nullptr when there is no room, or, after a
  /// warning, when the disk is full.
  std::shared_ptr<StorageFile> write(torch::serialize::OutputArchive& archive, std::int64_t bytes);
  /// A file that a checkpoint refers to. Reading it fails if it does not exist.
  std::shared_ptr<StorageFile> open(const std::string& name, std::int64_t bytes);
  /// Keeps the files that the newest checkpoint refers to, until the next call.
  void keep(const StorageFiles& files);
  /// The same after a checkpoint was read; deletes all other files.
  void restore(const StorageFiles& files);

 private:
  std::filesystem::path next_path();

  std::filesystem::path folder_;
  double max_bytes_ = 0.0;
  std::shared_ptr<std::atomic<std::int64_t>> used_;
  std::atomic<bool> failed_ = false;
  std::mutex mutex_;
  std::int64_t count_ = -1;  ///< of file names so far; -1: not known
  StorageFiles kept_;
};

}  // namespace apvi::mapping
