// SPDX-License-Identifier: BSD-3-Clause
#include "support/source_dir.hpp"

namespace apvi::test {

const std::filesystem::path& source_dir() {
  static const std::filesystem::path dir = APVI_SOURCE_DIR;
  return dir;
}

}  // namespace apvi::test
