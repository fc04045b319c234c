// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/model/archive.hpp"

#include <torch/torch.h>

#include <ostream>

#include "apvi/core/error.hpp"
#include "core/atomic_file.hpp"
#include "gaussians/device.hpp"

namespace apvi::gaussians {
namespace {

c10::IValue read_value(torch::serialize::InputArchive& archive, const char* key) {
  c10::IValue value;
  archive.read(key, value);
  return value;
}

}  // namespace

void write_archive(const std::filesystem::path& file, torch::serialize::OutputArchive& archive) {
  // Reports success to LibTorch, because its writer's destructor throws on failure; write errors
  // are kept in `out` and checked by write_file_atomically.
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
    archive.load_from(file.string(), torch::kCPU);  // independent of the device it was saved from
    read(archive);
  } catch (const c10::Error& e) {
    if (is_out_of_memory(e)) throw;  // not an error of the file
    fail_input("{}: cannot resume from this checkpoint: {}; delete it to start over", file.string(),
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

}  // namespace apvi::gaussians
