// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

namespace apvi {

/// Content of a file; empty if it cannot be read.
std::string read_text(const std::filesystem::path& file);
/// Last line that is not blank, without surrounding white space: in a program's log usually the
/// reason for its failure. Empty if there is none.
std::string last_line(const std::filesystem::path& file);

}  // namespace apvi
