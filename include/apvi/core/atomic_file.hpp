// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>

namespace apvi {

/// Writes a file in one step: `write` fills a file beside it, which then takes its name, so that
/// a full disk or a stop half-way leaves what was there before. Throws RunError naming the file
/// and the reason.
void write_file_atomically(const std::filesystem::path& path,
                           const std::function<void(std::ostream&)>& write);

}  // namespace apvi
