// SPDX-License-Identifier: BSD-3-Clause
#include "archive.hpp"

#include <torch/torch.h>

#include <ostream>

#include "apvi/core/atomic_file.hpp"
#include "apvi/core/error.hpp"
#include "apvi/splat/device.hpp"

namespace apvi::mapping {
namespace {

c10::IValue read_value(torch::serialize::InputArchive& archive, const char* key) {
  c10::IValue value;
  archive.read(key, value);
  return value;
}

}  // namespace

void write_archive(const std::filesystem::path& file, torch::serialize::OutputArchive& archive) {
  // LibTorch is told that all was written, because a destructor of its own throws when it was not;
  // `out` remembers.
  write_file_atomically(file, [&archive](std::ostream& out) {
    archive.save_to([&out](const void* bytes, std::size_t count) {
      out.write(static_cast<const char*>(bytes), static_cast<std::streamsize>(count));
      return count;
    });
  });
}

void read_archive(const std::filesystem::path& file,
                  const std::function<void(torch::serialize::InputArchive&)>& read) {
  try {
    torch::serialize::InputArchive archive;
    archive.load_from(file.string(), torch::kCPU);  // wherever it was written
    read(archive);
  } catch (const c10::Error& e) {
    if (splat::is_out_of_memory(e)) throw;  // which is not the file's fault
    fail_input("{}: cannot be resumed: {}; delete it to start anew", file.string(),
               e.what_without_backtrace());
  }
}

std::int64_t read_int(torch::serialize::InputArchive& archive, const char* key) {
  return read_value(archive, key).toInt();
}

double read_double(torch::serialize::InputArchive& archive, const char* key) {
  return read_value(archive, key).toDouble();
}

bool read_bool(torch::serialize::InputArchive& archive, const char* key) {
  return read_value(archive, key).toBool();
}

}  // namespace apvi::mapping
