// SPDX-License-Identifier: BSD-3-Clause
#include "cli/configurations.hpp"

#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "config/inherited_file.hpp"
#include "core/child_process.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

// Of <prefix>/bin/apvi: the installation; of <source>/build/<preset>/bin/apvi: the source tree.
std::vector<fs::path> data_folders() {
  const fs::path bin = current_executable().parent_path();
  return {(bin / "../share/apvi").lexically_normal(), (bin / "../../..").lexically_normal()};
}

}  // namespace

std::vector<fs::path> configuration_folders() {
  std::vector<fs::path> folders;
  for (const fs::path& folder : data_folders()) {
    if (fs::is_directory(folder / "configs")) folders.push_back(folder / "configs");
  }
  return folders;
}

fs::path find_configuration(const fs::path& name) {
  if (fs::exists(name)) return name;
  const std::vector<fs::path> folders = configuration_folders();
  if (const auto found = config::find_in_folders(folders, name)) return *found;
  std::string places;
  for (const fs::path& folder : folders) places += ", nor in " + folder.string();
  if (folders.empty()) {
    places =
        "; the program's own configurations are not beside it, in ../share/apvi/configs: was "
        "it copied alone?";
  }
  fail_input("{}: no such file or folder{}", name.string(), places);
}

std::optional<fs::path> find_script(const fs::path& name) {
  for (const fs::path& folder : data_folders()) {
    if (fs::exists(folder / "scripts" / name)) return folder / "scripts" / name;
  }
  return std::nullopt;
}

}  // namespace apvi::cli
