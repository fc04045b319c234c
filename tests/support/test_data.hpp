// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>

#include "support/source_dir.hpp"

namespace apvi::test {

/// Folder of a real recording, which is not part of the repository: below $APVI_TEST_DATA, else
/// below `../shared/data`, relative to the source tree. nullopt if absent; the test is then
/// skipped.
inline std::optional<std::filesystem::path> real_data(const std::string& name) {
  const char* root = std::getenv("APVI_TEST_DATA");
  const std::filesystem::path base = root != nullptr
                                         ? std::filesystem::path(root)
                                         : source_dir().parent_path() / "shared" / "data";
  if (!std::filesystem::exists(base / name)) return std::nullopt;
  return base / name;
}

}  // namespace apvi::test

/// Defines the path `variable` of a recording, or skips the test if it is absent.
#define APVI_NEEDS_DATA(variable, name)                                                \
  const auto variable##_found = ::apvi::test::real_data(name);                         \
  if (!variable##_found)                                                               \
    GTEST_SKIP() << "real recording " << (name) << " not present; set APVI_TEST_DATA"; \
  const std::filesystem::path variable = *variable##_found
