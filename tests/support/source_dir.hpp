// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

namespace apvi::test {

/// The root of the source tree.
const std::filesystem::path& source_dir();

}  // namespace apvi::test
