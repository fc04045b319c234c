// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <set>
#include <string>

namespace apvi::live {

/// "SCHEME://TARGET?KEY=VALUE&KEY=VALUE"; a text without a scheme is a path.
struct SourceUrl {
  std::string text;
  std::string scheme;  ///< empty for a path
  std::string target;
  std::map<std::string, std::string> options;

  /// Throws InputError for an option without a value.
  static SourceUrl parse(const std::string& text);
  /// The option, or `fallback`. Throws InputError when it is no number in [low, high].
  double number(const std::string& key, double fallback, double low, double high) const;
  /// Throws InputError for an option that is not among those known.
  void check_options(const std::set<std::string>& known) const;
};

}  // namespace apvi::live
