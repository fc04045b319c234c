// SPDX-License-Identifier: BSD-3-Clause
#include "live/source_url.hpp"

#include <string_view>
#include <vector>

#include "apvi/core/error.hpp"
#include "core/text.hpp"

namespace apvi::live {

SourceUrl SourceUrl::parse(const std::string& text) {
  SourceUrl url{.text = text, .scheme = {}, .target = text, .options = {}};
  const std::size_t colon = text.find("://");
  if (colon == std::string::npos) return url;
  url.scheme = text::to_lower(text.substr(0, colon));
  url.target = text.substr(colon + 3);
  const std::size_t question = url.target.rfind('?');
  // A camera's own address may have a query.
  if (question == std::string::npos || url.scheme == "rtsp") return url;
  std::vector<std::string_view> parts;
  const std::string query = url.target.substr(question + 1);
  text::split(query, '&', parts);
  for (const std::string_view part : parts) {
    const std::size_t equals = part.find('=');
    if (equals == std::string_view::npos) fail_input("{}: {}: expected KEY=VALUE", text, part);
    url.options[std::string(part.substr(0, equals))] = part.substr(equals + 1);
  }
  url.target.resize(question);
  return url;
}

double SourceUrl::number(const std::string& key, double fallback, double low, double high) const {
  const auto found = options.find(key);
  if (found == options.end()) return fallback;
  const auto value = text::parse_double(found->second);
  if (!value || !(*value >= low && *value <= high)) {
    fail_input("{}: {}: expected a number from {} to {}", text, key, low, high);
  }
  return *value;
}

void SourceUrl::check_options(const std::set<std::string>& known) const {
  for (const auto& [key, value] : options) {
    if (!known.contains(key)) fail_input("{}: unknown option {}", text, key);
  }
}

}  // namespace apvi::live
