// SPDX-License-Identifier: BSD-3-Clause
#include "config/inherited_file.hpp"

#include <fmt/format.h>

#include <string>

namespace apvi::config {

namespace fs = std::filesystem;

std::optional<fs::path> find_in_folders(const std::vector<fs::path>& folders,
                                        const fs::path& name) {
  for (const fs::path& folder : folders) {
    const bool named = !name.empty() && *name.begin() == folder.filename();
    const fs::path file = (named ? folder.parent_path() : folder) / name;
    if (fs::is_regular_file(file)) return file;
  }
  return std::nullopt;
}

fs::path inherited_file(const Node& name, std::string_view key, const fs::path& folder,
                        const std::vector<fs::path>& search) {
  if (name.kind != Node::Kind::scalar) fail_at(name, key, "expected a file name");
  fs::path beside = folder / name.text;
  if (fs::exists(beside)) return beside;
  if (const auto found = find_in_folders(search, name.text)) return *found;
  std::string places = "relative to this file";
  for (const fs::path& other : search) places += ", or in " + other.string();
  fail_at(name, key, fmt::format("no such file: {} ({})", name.text, places));
}

}  // namespace apvi::config
