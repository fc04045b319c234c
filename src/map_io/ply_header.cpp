// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/ply_header.hpp"

#include <algorithm>
#include <array>
#include <istream>
#include <string_view>
#include <utility>

#include "apvi/core/error.hpp"
#include "core/text.hpp"

namespace apvi::map_io {
namespace {

constexpr int kMaxLines = 4096;
constexpr std::size_t kMaxLineBytes = 4096;
constexpr std::int64_t kMaxRows = std::int64_t{1} << 40;  // sizes in bytes cannot overflow

constexpr std::array<std::pair<std::string_view, PlyType>, 16> kTypes = {{
    {"char", PlyType::int8},
    {"int8", PlyType::int8},
    {"uchar", PlyType::uint8},
    {"uint8", PlyType::uint8},
    {"short", PlyType::int16},
    {"int16", PlyType::int16},
    {"ushort", PlyType::uint16},
    {"uint16", PlyType::uint16},
    {"int", PlyType::int32},
    {"int32", PlyType::int32},
    {"uint", PlyType::uint32},
    {"uint32", PlyType::uint32},
    {"float", PlyType::float32},
    {"float32", PlyType::float32},
    {"double", PlyType::float64},
    {"float64", PlyType::float64},
}};

class HeaderParser {
 public:
  HeaderParser(std::istream& in, const std::string& file) : in_(in), file_(file) {}

  PlyHeader parse() {
    if (next_line() != "ply") fail("the first line is not \"ply\": is it a PLY file?");
    for (;;) {
      const std::string line = next_line();
      std::vector<std::string_view> words;
      for (const std::string_view word : split_words(line)) words.push_back(word);
      if (words.empty() || words[0] == "obj_info") continue;
      if (words[0] == "end_header") break;
      parse_line(line, words);
    }
    if (!has_format_) fail("the header has no format line");
    if (header_.find("vertex") == nullptr) fail("the header has no vertex element");
    header_.lines = line_;
    return std::move(header_);
  }

 private:
  template <typename... Args>
  [[noreturn]] void fail(fmt::format_string<Args...> format, Args&&... args) const {
    fail_input("{}:{}: {}", file_, line_, fmt::format(format, std::forward<Args>(args)...));
  }

  // Bounded, so that a large file without line breaks is not read entirely.
  std::string next_line() {
    if (++line_ > kMaxLines) fail("no end_header found: is it a PLY file?");
    std::string line;
    for (int c = in_.get(); c != '\n'; c = in_.get()) {
      if (c == std::istream::traits_type::eof()) fail("the file ends within the header");
      if (line.size() >= kMaxLineBytes) fail("this line is too long for a PLY header");
      line.push_back(static_cast<char>(c));
    }
    std::replace(line.begin(), line.end(), '\t', ' ');
    return std::string(text::trim(line));
  }

  static std::vector<std::string_view> split_words(std::string_view line) {
    std::vector<std::string_view> parts;
    std::vector<std::string_view> words;
    text::split(line, ' ', parts);
    for (const std::string_view part : parts) {
      if (!part.empty()) words.push_back(part);
    }
    return words;
  }

  void parse_line(const std::string& line, const std::vector<std::string_view>& words) {
    if (words[0] == "comment") {
      header_.comments.emplace_back(text::trim(std::string_view(line).substr(7)));
    } else if (words[0] == "format") {
      parse_format(words);
    } else if (words[0] == "element") {
      parse_element(words);
    } else if (words[0] == "property") {
      parse_property(words);
    } else {
      fail("unknown PLY header keyword \"{:.40}\"", words[0]);
    }
  }

  void parse_format(const std::vector<std::string_view>& words) {
    const std::string_view word = words.size() > 1 ? words[1] : "";
    if (word == "ascii") {
      header_.encoding = PlyEncoding::ascii;
    } else if (word == "binary_little_endian") {
      header_.encoding = PlyEncoding::little_endian;
    } else if (word == "binary_big_endian") {
      header_.encoding = PlyEncoding::big_endian;
    } else {
      fail("the format must be ascii, binary_little_endian or binary_big_endian");
    }
    has_format_ = true;
  }

  void parse_element(const std::vector<std::string_view>& words) {
    const std::int64_t count = words.size() == 3 ? text::parse_int64(words[2]).value_or(-1) : -1;
    if (words.size() < 2) fail("expected: element NAME COUNT");
    if (count < 0 || count > kMaxRows) fail("invalid count of element {:.40}", words[1]);
    header_.elements.push_back({.name = std::string(words[1]), .rows = count, .properties = {}});
  }

  void parse_property(const std::vector<std::string_view>& words) {
    if (header_.elements.empty()) fail("a property must follow an element");
    PlyElement& element = header_.elements.back();
    if (words.size() > 1 && words[1] == "list") {
      if (element.name == "vertex") fail("list properties of vertices are not supported");
      element.has_list = true;
      return;
    }
    if (words.size() != 3) fail("expected: property TYPE NAME");
    if (element.find(words[2])) fail("duplicate property {:.40}", words[2]);
    for (const auto& [name, type] : kTypes) {
      if (name != words[1]) continue;
      element.properties.push_back({std::string(words[2]), type});
      return;
    }
    fail("unknown PLY property type \"{:.40}\"", words[1]);
  }

  std::istream& in_;
  const std::string& file_;
  PlyHeader header_;
  int line_ = 0;
  bool has_format_ = false;
};

}  // namespace

std::optional<std::size_t> PlyElement::find(std::string_view property) const {
  for (std::size_t i = 0; i < properties.size(); ++i) {
    if (properties[i].name == property) return i;
  }
  return std::nullopt;
}

std::int64_t PlyElement::row_bytes() const {
  std::int64_t bytes = 0;
  for (const PlyProperty& property : properties) bytes += size_of(property.type);
  return bytes;
}

const PlyElement* PlyHeader::find(std::string_view element) const {
  for (const PlyElement& known : elements) {
    if (known.name == element) return &known;
  }
  return nullptr;
}

PlyHeader read_ply_header(std::istream& in, const std::string& file) {
  return HeaderParser(in, file).parse();
}

std::int64_t size_of(PlyType type) {
  switch (type) {
    case PlyType::int8:
    case PlyType::uint8:
      return 1;
    case PlyType::int16:
    case PlyType::uint16:
      return 2;
    case PlyType::float64:
      return 8;
    case PlyType::int32:
    case PlyType::uint32:
    case PlyType::float32:
      break;
  }
  return 4;
}

}  // namespace apvi::map_io
