// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/serialize/archive.h>

#include <cstdint>
#include <filesystem>
#include <functional>

namespace apvi::mapping {

/// Writes a checkpoint in one step. Throws RunError when it cannot be written.
void write_archive(const std::filesystem::path& file, torch::serialize::OutputArchive& archive);

/// Opens a checkpoint and lets `read` take what it needs. Throws InputError when the file is
/// damaged, or when `read` throws c10::Error, but for want of memory, which is passed on.
void read_archive(const std::filesystem::path& file,
                  const std::function<void(torch::serialize::InputArchive&)>& read);

/// What a checkpoint holds under a name. Throw c10::Error when that is nothing or of another type.
std::int64_t read_int(torch::serialize::InputArchive& archive, const char* key);
double read_double(torch::serialize::InputArchive& archive, const char* key);
bool read_bool(torch::serialize::InputArchive& archive, const char* key);

}  // namespace apvi::mapping
