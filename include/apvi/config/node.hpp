// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace apvi::config {

/// A value of a configuration file that remembers where it came from, through inheritance and
/// overrides, so that every complaint can name file and line.
struct Node {
  enum class Kind { null, scalar, list, map };

  Kind kind = Kind::null;
  std::string text;                                   ///< of a scalar
  std::vector<Node> items;                            ///< of a list
  std::vector<std::pair<std::string, Node>> members;  ///< of a map, in the file's order
  std::shared_ptr<const std::string> source;          ///< file name, or "--set"
  int line = 0;                                       ///< from 1; 0 when there is none

  Node();  // out of line: clang would otherwise look into `members` while Node is incomplete

  bool is_null() const { return kind == Kind::null; }
  const Node* find(std::string_view key) const;
  /// The member of that name, made if it is not there; turns a null node into a map.
  Node& member(std::string_view key);
  /// "file:line", "--set", or "" for a default.
  std::string where() const;
};

/// Throws InputError "file:line: key: what".
[[noreturn]] void fail_at(const Node& node, std::string_view key, std::string_view what);

/// Parses one YAML file. Throws InputError when it is missing or no YAML, and for duplicate keys.
Node load_file(const std::filesystem::path& path);
/// The same from text; `source` stands for the file name in messages.
Node parse_yaml(const std::string& text, const std::string& source);
/// Parses a file and what it names under `inherit:` (one path or a list, relative to the file),
/// left to right, the file itself last. Throws InputError for a cycle.
Node load_with_inheritance(const std::filesystem::path& path);
/// Lays `over` on top of `base`: maps merge deep, everything else replaces.
void merge(Node& base, const Node& over);
/// Applies "a.b.c=value"; the value is YAML. Throws InputError when there is no '='.
void apply_override(Node& root, std::string_view assignment);
/// The node as a YAML document.
std::string to_yaml(const Node& node);

}  // namespace apvi::config
