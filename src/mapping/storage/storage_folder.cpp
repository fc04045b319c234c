// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/storage/storage_folder.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <algorithm>
#include <optional>
#include <system_error>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/text.hpp"
#include "gaussians/device.hpp"
#include "gaussians/model/archive.hpp"

namespace apvi::mapping {
namespace {

namespace fs = std::filesystem;

constexpr const char* kExtension = ".pt";

/// One more than the largest number among the names of the files that are there.
std::int64_t first_free_number(const fs::path& folder) {
  std::int64_t next = 0;
  std::error_code ignored;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, ignored)) {
    const auto number = text::parse_int64(entry.path().stem().string());
    if (number) next = std::max(next, *number + 1);
  }
  return next;
}

}  // namespace

StorageFile::StorageFile(fs::path path, std::int64_t bytes,
                         std::shared_ptr<std::atomic<std::int64_t>> used)
    : path_(std::move(path)), bytes_(bytes), used_(std::move(used)) {
  *used_ += bytes_;
}

StorageFile::~StorageFile() {
  *used_ -= bytes_;
  if (kept_) return;
  std::error_code ignored;
  fs::remove(path_, ignored);
}

bool StorageFile::read(
    const std::function<void(torch::serialize::InputArchive&)>& read_archive) const {
  try {
    torch::serialize::InputArchive archive;
    archive.load_from(path_.string(), torch::kCPU);
    read_archive(archive);
    return true;
  } catch (const c10::Error& error) {
    if (gaussians::is_out_of_memory(error)) throw;
    log::warning("{}: cannot be read; this part of the map is lost: {}", path_.string(),
                 fs::exists(path_) ? error.what_without_backtrace() : "no such file");
    return false;
  }
}

StorageFolder::StorageFolder(fs::path folder, double max_bytes)
    : folder_(std::move(folder)),
      max_bytes_(max_bytes),
      used_(std::make_shared<std::atomic<std::int64_t>>(0)) {}

StorageFolder::~StorageFolder() {
  std::error_code ignored;
  if (!folder_.empty()) fs::remove(folder_, ignored);  // only if nothing is in it
}

bool StorageFolder::has_room() const {
  return !folder_.empty() && !failed_ && static_cast<double>(*used_) < max_bytes_;
}

std::shared_ptr<StorageFile> StorageFolder::write(torch::serialize::OutputArchive& archive,
                                                  std::int64_t bytes) {
  if (!has_room()) return nullptr;
  const fs::path path = next_path();
  try {
    gaussians::write_archive(path, archive);
  } catch (const RunError& error) {
    failed_ = true;
    log::warning("{}; the map is limited by memory from now on", error.what());
    return nullptr;
  }
  return std::make_shared<StorageFile>(path, bytes, used_);
}

fs::path StorageFolder::next_path() {
  const std::scoped_lock lock(mutex_);
  std::error_code ignored;  // reported when the file is written
  fs::create_directories(folder_, ignored);
  if (count_ < 0) count_ = first_free_number(folder_);
  return folder_ / fmt::format("{}{}", count_++, kExtension);
}

std::shared_ptr<StorageFile> StorageFolder::open(const std::string& name, std::int64_t bytes) {
  return std::make_shared<StorageFile>(folder_ / name, bytes, used_);
}

void StorageFolder::keep(const StorageFiles& files) {
  const std::scoped_lock lock(mutex_);
  for (const auto& file : kept_) file->keep(false);
  for (const auto& file : files) file->keep(true);
  kept_ = files;
}

void StorageFolder::restore(const StorageFiles& files) {
  keep(files);
  std::error_code ignored;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, ignored)) {
    const std::string name = entry.path().filename().string();
    const bool is_kept = std::any_of(files.begin(), files.end(),
                                     [&](const auto& file) { return file->name() == name; });
    if (!is_kept) fs::remove(entry.path(), ignored);
  }
}

}  // namespace apvi::mapping
