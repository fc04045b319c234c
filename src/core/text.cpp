// SPDX-License-Identifier: BSD-3-Clause
#include "core/text.hpp"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <numeric>
#include <utility>

namespace apvi::text {
namespace {

template <typename T>
std::optional<T> parse_number(std::string_view text) {
  text = trim(text);
  if (text.starts_with('+')) {
    text.remove_prefix(1);
    if (text.starts_with('-')) return std::nullopt;
  }
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || text.empty()) return std::nullopt;
  return value;
}

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i);
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t substituted = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({substituted, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row.back();
}

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

}  // namespace

std::string_view trim(std::string_view text) {
  const auto is_space = [](char c) { return std::isspace(static_cast<unsigned char>(c)) != 0; };
  while (!text.empty() && is_space(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_space(text.back())) text.remove_suffix(1);
  return text;
}

void split(std::string_view line, char separator, std::vector<std::string_view>& parts) {
  parts.clear();
  std::size_t begin = 0;
  for (std::size_t end = line.find(separator); end != std::string_view::npos;
       end = line.find(separator, begin)) {
    parts.push_back(trim(line.substr(begin, end - begin)));
    begin = end + 1;
  }
  parts.push_back(trim(line.substr(begin)));
}

std::optional<double> parse_double(std::string_view text) {
  return parse_number<double>(text);
}

std::optional<std::int64_t> parse_int64(std::string_view text) {
  return parse_number<std::int64_t>(text);
}

std::optional<std::int64_t> parse_seconds_as_ns(std::string_view text) {
  text = trim(text);
  const bool negative = text.starts_with('-');
  if (negative) {
    text.remove_prefix(1);
    if (text.empty() || !(is_digit(text.front()) || text.front() == '.')) return std::nullopt;
  }
  const std::size_t point = std::min(text.find('.'), text.size());
  const std::string_view whole = text.substr(0, point);
  std::string fraction(point < text.size() ? text.substr(point + 1) : std::string_view{});
  const bool digits = std::all_of(whole.begin(), whole.end(), is_digit) &&
                      std::all_of(fraction.begin(), fraction.end(), is_digit);
  if (!digits || whole.empty() || whole.size() > 10) {
    // Exponents ("1.4e9") and the like are parsed as double.
    const auto seconds = parse_double(text);
    if (!seconds || !(*seconds < 9.2e9 && *seconds > -9.2e9)) return std::nullopt;
    const auto ns = static_cast<std::int64_t>(*seconds * 1e9 + (*seconds < 0 ? -0.5 : 0.5));
    return negative ? -ns : ns;
  }
  const bool round_up = fraction.size() > 9 && fraction[9] >= '5';
  fraction.resize(9, '0');
  const auto seconds = parse_int64(whole);
  const auto ns = parse_int64(fraction);
  if (!seconds || !ns || *seconds > 9'200'000'000) return std::nullopt;
  const std::int64_t total = *seconds * 1'000'000'000 + *ns + (round_up ? 1 : 0);
  return negative ? -total : total;
}

std::string to_lower(std::string_view text) {
  std::string lower(text);
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return lower;
}

std::optional<std::string> closest_match(std::string_view word,
                                         const std::vector<std::string>& candidates) {
  const auto distance = [&](const std::string& c) { return edit_distance(word, c); };
  const auto best = std::min_element(
      candidates.begin(), candidates.end(),
      [&](const std::string& a, const std::string& b) { return distance(a) < distance(b); });
  if (best == candidates.end() || distance(*best) > 1 + word.size() / 3) return std::nullopt;
  return *best;
}

}  // namespace apvi::text
