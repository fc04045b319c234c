// SPDX-License-Identifier: BSD-3-Clause
#include "cli/configurations.hpp"

#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "core/child_process.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

// Of <prefix>/bin/apvi: the installation; of <source>/build/<preset>/bin/apvi: the source tree.
std::vector<fs::path> data_folders() {
  const fs::path bin = current_executable().parent_path();
  return {(bin / "../share/apvi").lexically_normal(), (bin / "../../..").lexically_normal()};
}

std::optional<fs::path> find_data(const fs::path& relative) {
  for (const fs::path& folder : data_folders()) {
    if (fs::exists(folder / relative)) return folder / relative;
  }
  return std::nullopt;
}

}  // namespace

std::filesystem::path find_configuration(const fs::path& name) {
  if (fs::exists(name)) return name;
  if (const auto found = find_data("configs" / name)) return *found;
  std::string places;
  for (const fs::path& folder : data_folders()) {
    places += (places.empty() ? "" : " and ") + (folder / "configs").string();
  }
  fail_input("{}: no such file, recording or configuration (also looked in {})", name.string(),
             places);
}

std::optional<fs::path> find_script(const fs::path& name) {
  return find_data("scripts" / name);
}

}  // namespace apvi::cli
