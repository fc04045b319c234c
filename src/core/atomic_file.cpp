// SPDX-License-Identifier: BSD-3-Clause
#include "core/atomic_file.hpp"

#include <cerrno>
#include <fstream>
#include <string>
#include <system_error>

#include "apvi/core/error.hpp"

namespace apvi {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const fs::path& partial, const fs::path& path, int error) {
  std::error_code ignored;
  fs::remove(partial, ignored);
  fail_run("{}: cannot be written: {}", path.string(),
           error != 0 ? std::generic_category().message(error) : "disk full?");
}

}  // namespace

void write_file_atomically(const fs::path& path, const std::function<void(std::ostream&)>& write) {
  fs::path partial = path;
  partial += ".partial";
  errno = 0;
  std::ofstream out(partial, std::ios::binary);
  if (out) write(out);
  out.close();  // a full disk may be reported only here
  if (!out) fail(partial, path, errno);
  std::error_code error;
  fs::rename(partial, path, error);
  if (error) fail(partial, path, error.value());
}

}  // namespace apvi
