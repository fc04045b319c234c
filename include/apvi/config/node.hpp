// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace apvi::config {

/// A configuration value with its source location, which is kept through inheritance and overrides
/// so that error messages can state file and line.
struct Node {
  enum class Kind { null, scalar, list, map };

  Kind kind = Kind::null;
  std::string text;                                   ///< of a scalar
  std::vector<Node> items;                            ///< of a list
  std::vector<std::pair<std::string, Node>> members;  ///< of a map, in the file's order
  std::shared_ptr<const std::string> source;          ///< file name, or "--set"
  int line = 0;                                       ///< from 1; 0 if unknown

  Node();  // out of line: `members` needs the complete type (clang)

  bool is_null() const { return kind == Kind::null; }
  const Node* find(std::string_view key) const;
  /// The member of that name, created if absent; turns any other kind of node into a map.
  Node& member(std::string_view key);
  /// "file:line", "--set", or "" for a default.
  std::string where() const;
};

/// Throws InputError "file:line: key: what".
[[noreturn]] void fail_at(const Node& node, std::string_view key, std::string_view what);

/// Parses one YAML file. Throws InputError if it is missing, invalid or has duplicate keys.
Node load_file(const std::filesystem::path& path);
/// Parses YAML text; `source` replaces the file name in messages.
Node parse_yaml(const std::string& text, const std::string& source);
/// Parses a file and the files listed under `inherit:` (one path or a list, relative to the file).
/// Later files override earlier ones, and the file itself all of them. Throws InputError for a
/// cycle.
Node load_with_inheritance(const std::filesystem::path& path);
/// Same, with a change to the keys of each file before it is merged with others, unless empty.
/// Files that are not there relative to the inheriting file are looked for in the folders `search`.
Node load_with_inheritance(const std::filesystem::path& path,
                           const std::function<void(Node&)>& edit,
                           const std::vector<std::filesystem::path>& search = {});
/// Merges `over` into `base`: maps are merged recursively, everything else is replaced.
void merge(Node& base, const Node& over);
/// A dotted key with a value, as in "a.b.c=value".
struct Override {
  std::string key;
  Node value;
};
/// Parses "a.b.c=value"; [..], {..} and quoted values are YAML, others literal. Throws InputError.
Override parse_override(std::string_view assignment);
/// Replaces the value of a dotted key. Throws InputError for an empty part of the key.
void set_value(Node& root, std::string_view key, Node value);
/// Both: applies "a.b.c=value".
void apply_override(Node& root, std::string_view assignment);
/// The node as a YAML document.
std::string to_yaml(const Node& node);

}  // namespace apvi::config
