// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/config/fields.hpp"

#include <fmt/ranges.h>

#include <algorithm>

#include "core/text.hpp"

namespace apvi::config {
namespace internal {
namespace {

const std::string& scalar_text(const Node& node, const std::string& key,
                               std::string_view expected) {
  if (node.kind != Node::Kind::scalar) fail_at(node, key, fmt::format("expected {}", expected));
  return node.text;
}

}  // namespace

void read_scalar(const Node& node, const std::string& key, bool& value) {
  const std::string word = text::to_lower(scalar_text(node, key, "true or false"));
  if (word == "true" || word == "yes" || word == "on") {
    value = true;
  } else if (word == "false" || word == "no" || word == "off") {
    value = false;
  } else {
    fail_at(node, key, fmt::format("expected true or false, got {}", node.text));
  }
}

void read_scalar(const Node& node, const std::string& key, int& value) {
  const auto number = text::parse_int64(scalar_text(node, key, "a whole number"));
  if (!number || *number < std::numeric_limits<int>::min() ||
      *number > std::numeric_limits<int>::max()) {
    fail_at(node, key, fmt::format("expected a whole number, got {}", node.text));
  }
  value = static_cast<int>(*number);
}

void read_scalar(const Node& node, const std::string& key, double& value) {
  const auto number = text::parse_double(scalar_text(node, key, "a number"));
  if (!number || !std::isfinite(*number)) {
    fail_at(node, key, fmt::format("expected a number, got {}", node.text));
  }
  value = *number;
}

void read_scalar(const Node& node, const std::string& key, std::string& value) {
  if (node.is_null()) {
    value.clear();
  } else {
    value = scalar_text(node, key, "a string");
  }
}

void fail_out_of_range(const Node& node, const std::string& key, const std::string& value,
                       const std::string& low, const std::string& high) {
  fail_at(node, key, fmt::format("{} is outside [{}, {}]", value, low, high));
}

void fail_unknown_choice(const Node& node, const std::string& key,
                         const std::vector<std::string>& words) {
  fail_at(node, key, fmt::format("{} is none of: {}", node.text, fmt::join(words, ", ")));
}

void check_known_keys(const Node& node, const std::string& path,
                      const std::vector<std::string>& known) {
  for (const auto& [name, member] : node.members) {
    if (std::find(known.begin(), known.end(), name) != known.end()) continue;
    const auto guess = text::closest_match(name, known);
    fail_at(member, "",
            fmt::format("unknown key {}; {}", join(path, name),
                        guess ? fmt::format("did you mean {}?", join(path, *guess))
                              : fmt::format("known here: {}", fmt::join(known, ", "))));
  }
}

std::string format_number(double value) {
  return fmt::format("{}", value);
}
std::string format_number(int value) {
  return fmt::format("{}", value);
}

std::string format_briefly(double value) {
  constexpr std::size_t kLong = 10;
  std::string text = format_number(value);
  return text.size() > kLong ? fmt::format("{:.4g}", value) : text;
}

Node scalar_node(std::string text) {
  Node node;
  node.kind = Node::Kind::scalar;
  node.text = std::move(text);
  return node;
}

std::string join(const std::string& path, std::string_view name) {
  return path.empty() ? std::string(name) : fmt::format("{}.{}", path, name);
}

std::string to_flow_yaml(const Node& node) {
  switch (node.kind) {
    case Node::Kind::null:
      return "null";
    case Node::Kind::scalar:
      return node.text.empty() ? "\"\"" : node.text;
    case Node::Kind::list: {
      std::vector<std::string> parts;
      for (const Node& item : node.items) parts.push_back(to_flow_yaml(item));
      return fmt::format("[{}]", fmt::join(parts, ", "));
    }
    case Node::Kind::map:
      return "{}";
  }
  return "";
}

}  // namespace internal

std::string to_markdown(const std::vector<FieldDoc>& rows) {
  std::string out = "| key | type | default | range | meaning |\n|---|---|---|---|---|\n";
  for (const FieldDoc& row : rows) {
    const bool section = row.type == "section";
    out += fmt::format("| {}`{}`{} | {} | {} | {} | {} |\n", section ? "**" : "", row.key,
                       section ? "**" : "", section ? "" : row.type,
                       row.default_value.empty() ? "" : fmt::format("`{}`", row.default_value),
                       row.range, row.doc);
  }
  return out;
}

}  // namespace apvi::config
