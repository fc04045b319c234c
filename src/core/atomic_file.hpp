// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>

namespace apvi {

/// Writes a file atomically: `write` fills a temporary file next to it, which is then renamed, so
/// that a full disk or an interruption leaves the previous content intact. Throws RunError with the
/// file and the reason.
void write_file_atomically(const std::filesystem::path& path,
                           const std::function<void(std::ostream&)>& write);

}  // namespace apvi
