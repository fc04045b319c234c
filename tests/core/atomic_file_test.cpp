// SPDX-License-Identifier: BSD-3-Clause
#include "core/atomic_file.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <string>

#include "apvi/core/error.hpp"
#include "support/tmp_dir.hpp"

namespace apvi {
namespace {

namespace fs = std::filesystem;

std::string content_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST(AtomicFile, ReplacesContentAndLeavesNoTemporaryFile) {
  const test::TmpDir dir;
  const fs::path file = dir.write("a.txt", "old");
  write_file_atomically(file, [](std::ostream& out) { out << "new"; });
  EXPECT_EQ(content_of(file), "new");
  EXPECT_EQ(std::distance(fs::directory_iterator(dir.path()), fs::directory_iterator()), 1);
}

TEST(AtomicFile, KeepsOldContentWhenWritingFails) {
  const test::TmpDir dir;
  const fs::path file = dir.write("a.txt", "old");
  const auto half = [](std::ostream& out) {
    out << "ne";
    out.setstate(std::ios::badbit);  // as a full disk does
  };
  EXPECT_THROW(write_file_atomically(file, half), RunError);
  EXPECT_EQ(content_of(file), "old");
  EXPECT_EQ(std::distance(fs::directory_iterator(dir.path()), fs::directory_iterator()), 1);
}

TEST(AtomicFile, ErrorNamesFile) {
  const test::TmpDir dir;
  try {
    write_file_atomically(dir.path() / "missing" / "a.txt", [](std::ostream&) {});
    FAIL() << "nothing was thrown";
  } catch (const RunError& e) {
    EXPECT_NE(std::string(e.what()).find("a.txt: cannot be written: No such file"),
              std::string::npos)
        << e.what();
  }
}

}  // namespace
}  // namespace apvi
