// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/config/node.hpp"

namespace apvi::config {

/// A key or section with a new name. Both are dotted and start at the root of the file. Several
/// old keys may share a new one.
struct RenamedKey {
  std::string_view old_key;
  std::string_view new_key;             ///< empty: the key has no effect any more
  double (*convert)(double) = nullptr;  ///< a number in the new unit, if that differs
};

/// A value of an enum with a new name; `key` is the new name of its key.
struct RenamedValue {
  std::string_view key;
  std::string_view old_value;
  std::string_view new_value;
};

/// Renamed keys and values of one kind of configuration file.
struct Renames {
  std::span<const RenamedKey> keys;
  std::span<const RenamedValue> values;
};

/// Release that drops the old names.
inline constexpr std::string_view kOldNamesUntil = "0.3";

const Renames& run_renames();
const Renames& scene_renames();

/// Replaces old names in configuration files, overrides and sweeps by the new ones. Logs one
/// warning per old name.
class KeyRenamer {
 public:
  enum class Warnings { on, off };

  explicit KeyRenamer(const Renames& renames, Warnings warnings = Warnings::on);

  /// Renames the keys of one file, override or sweep entry, before it is merged with others. Throws
  /// InputError if a key is given by both its old and its new name.
  void apply(Node& layer);
  /// The new name of a dotted key.
  std::string renamed(std::string_view key) const;
  /// Applies "a.b.c=value" to `root`, where either name is accepted.
  void apply_override(Node& root, std::string_view assignment);

 private:
  void rename(Node& layer, const RenamedKey& key, std::set<std::string>& inserted);
  void warn(const Node& node, std::string_view old_name, std::string_view new_name);
  void warn_dropped(const Node& node, std::string_view key);
  bool is_first_warning(std::string_view old_name);

  std::vector<RenamedKey> keys_;  ///< nested keys before their sections
  std::span<const RenamedValue> values_;
  Warnings warnings_;
  std::set<std::string, std::less<>> warned_;
  std::map<std::string, std::string> overridden_;  ///< new name of a key to the name given
};

/// Reads a configuration file with its inherited files and applies the overrides "key=value" in
/// order. Old names are accepted in all of them. `search`: see load_with_inheritance.
Node load_config(const std::filesystem::path& file, const std::vector<std::string>& overrides,
                 const Renames& renames, const std::vector<std::filesystem::path>& search = {});
/// Reads a file that the program wrote, such as resolved.yaml of an older run: no warnings.
Node load_recorded_config(const std::filesystem::path& file, const Renames& renames);

/// The old and new names as a Markdown table.
std::string to_markdown(const Renames& renames);

}  // namespace apvi::config
