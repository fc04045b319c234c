// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/serialize/archive.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "gaussians/model/gaussians.hpp"

namespace apvi::gaussians {

/// Writes a checkpoint atomically. Throws RunError when it cannot be written.
void write_archive(const std::filesystem::path& file, torch::serialize::OutputArchive& archive);

/// Opens a checkpoint and calls `read`. Throws InputError when the file is damaged or `read` throws
/// c10::Error; out-of-memory errors are rethrown.
void read_archive(const std::filesystem::path& file,
                  const std::function<void(torch::serialize::InputArchive&)>& read);

/// Writes the tensors, from CPU memory, with names that begin with `prefix`.
void write_gaussians(torch::serialize::OutputArchive& archive, const std::string& prefix,
                     const Gaussians& gaussians);
/// Reads them into CPU memory. Throws c10::Error when they are missing or do not match.
Gaussians read_gaussians(torch::serialize::InputArchive& archive, const std::string& prefix);

/// Reads a value of a checkpoint. Throw c10::Error when it is missing or has another type.
std::int64_t read_int(torch::serialize::InputArchive& archive, const char* key);
double read_double(torch::serialize::InputArchive& archive, const char* key);
bool read_bool(torch::serialize::InputArchive& archive, const char* key);

}  // namespace apvi::gaussians
