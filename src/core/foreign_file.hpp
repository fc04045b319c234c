// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace apvi {

/// What a file is that the program does not read as it is, and what would help, for the end of a
/// message: "a zip archive: unpack it and name what is in it". Told by its first bytes and by its
/// name; nullopt for folders, for files that cannot be read, and for all others.
std::optional<std::string> describe_foreign_file(const std::filesystem::path& file);

}  // namespace apvi
