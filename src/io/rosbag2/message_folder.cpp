// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag2/message_folder.hpp"

#include <fstream>
#include <iterator>

#include "apvi/core/error.hpp"
#include "io/rosbag2/ros2_definitions.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;

std::string type_of(const fs::path& file) {
  const fs::path folder = file.parent_path();
  const fs::path package = folder.filename() == "msg" ? folder.parent_path() : folder;
  return package.filename().string() + "/" + file.stem().string();
}

std::string text_of(const fs::path& file) {
  std::ifstream in(file);
  if (!in) fail_input("{}: cannot be read", file.string());
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

MessageFolder::MessageFolder(const fs::path& folder) {
  std::error_code problem;
  for (fs::recursive_directory_iterator it(folder, problem), end; !problem && it != end;
       it.increment(problem)) {
    if (it->path().extension() == ".msg") texts_.emplace(type_of(it->path()), text_of(it->path()));
  }
  if (texts_.empty()) {
    fail_input("{}: no .msg files below this folder; check dataset.message_definitions",
               folder.string());
  }
}

// All other types follow as candidates for nested ones; the parser resolves those it needs.
std::vector<std::string> MessageFolder::definitions(const std::string& type) const {
  const auto own = texts_.find(type);
  if (own == texts_.end()) return ros2_definitions(type);
  std::string text = own->second;
  for (const auto& [name, nested] : texts_) {
    if (name != type) text.append(ros2_section(name, nested));
  }
  return {text.append(ros2_sections())};
}

}  // namespace apvi::io
