// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>

#include "support/source_dir.hpp"

namespace apvi::test {

/// A folder of the real recordings, which are not part of the project: below $APVI_TEST_DATA, or
/// below `../shared/data` beside the source tree. Nothing when it is not there; the test skips
/// then.
inline std::optional<std::filesystem::path> real_data(const std::string& name) {
  const char* root = std::getenv("APVI_TEST_DATA");
  const std::filesystem::path base = root != nullptr
                                         ? std::filesystem::path(root)
                                         : source_dir().parent_path() / "shared" / "data";
  if (!std::filesystem::exists(base / name)) return std::nullopt;
  return base / name;
}

}  // namespace apvi::test

/// Skips the test unless the recording is there; else defines the path `variable`.
#define APVI_NEEDS_DATA(variable, name)                                                \
  const auto variable##_found = ::apvi::test::real_data(name);                         \
  if (!variable##_found)                                                               \
    GTEST_SKIP() << "real recording " << (name) << " not present; set APVI_TEST_DATA"; \
  const std::filesystem::path variable = *variable##_found
