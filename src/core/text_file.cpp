// SPDX-License-Identifier: BSD-3-Clause
#include "core/text_file.hpp"

#include <fstream>
#include <sstream>

#include "core/text.hpp"

namespace apvi {

std::string read_text(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

std::string last_line(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::string last;
  for (std::string line; std::getline(in, line);) {
    if (const auto content = text::trim(line); !content.empty()) last = content;
  }
  return last;
}

}  // namespace apvi
