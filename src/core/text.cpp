// SPDX-License-Identifier: BSD-3-Clause
#include "core/text.hpp"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdlib>
#include <limits>
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

constexpr int kMaxExponent = 400;  // of a double, with room

// "12.5" as the digits 125 and one decimal.
struct Decimal {
  std::string digits;
  int decimals = 0;
};

std::optional<Decimal> split_decimal(std::string_view text) {
  const std::size_t point = std::min(text.find('.'), text.size());
  Decimal decimal{std::string(text.substr(0, point)), 0};
  if (point < text.size()) decimal.digits += text.substr(point + 1);
  decimal.decimals = static_cast<int>(decimal.digits.size() - point);
  const bool valid = !decimal.digits.empty() &&
                     std::all_of(decimal.digits.begin(), decimal.digits.end(), is_digit);
  if (!valid) return std::nullopt;
  return decimal;
}

// The decimal times 10^power, rounded half up.
std::optional<std::int64_t> to_magnitude(Decimal decimal, int power) {
  const int shift = power - decimal.decimals;
  const auto keep = static_cast<int>(decimal.digits.size()) + std::min(shift, 0);
  const bool zero = decimal.digits.find_first_not_of('0') == std::string::npos;
  if (keep < 0 || zero) return 0;
  const auto kept = static_cast<std::size_t>(keep);
  const bool round_up = kept < decimal.digits.size() && decimal.digits[kept] >= '5';
  decimal.digits.resize(kept);
  if (shift > 0) decimal.digits.append(static_cast<std::size_t>(shift), '0');
  const auto whole = parse_number<std::int64_t>(kept == 0 ? "0" : decimal.digits);
  if (!whole || *whole == std::numeric_limits<std::int64_t>::max()) return std::nullopt;
  return *whole + (round_up ? 1 : 0);
}

}  // namespace

std::string_view trim(std::string_view text) {
  const auto is_space = [](char c) { return std::isspace(static_cast<unsigned char>(c)) != 0; };
  while (!text.empty() && is_space(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_space(text.back())) text.remove_suffix(1);
  return text;
}

std::string_view without_byte_order_mark(std::string_view text) {
  constexpr std::string_view kMark = "\xEF\xBB\xBF";
  if (text.starts_with(kMark)) text.remove_prefix(kMark.size());
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

std::optional<std::int64_t> parse_scaled_int64(std::string_view text, int power) {
  text = trim(text);
  const bool negative = text.starts_with('-');
  if (negative || text.starts_with('+')) text.remove_prefix(1);
  const std::size_t e = std::min(text.find_first_of("eE"), text.size());
  const auto exponent =
      e == text.size() ? std::optional<int>(0) : parse_number<int>(text.substr(e + 1));
  const auto decimal = split_decimal(text.substr(0, e));
  if (!exponent || !decimal || std::abs(*exponent) > kMaxExponent) return std::nullopt;
  const auto magnitude = to_magnitude(*decimal, *exponent + power);
  if (!magnitude) return std::nullopt;
  return negative ? -*magnitude : *magnitude;
}

std::optional<std::int64_t> parse_seconds_as_ns(std::string_view text) {
  const auto ns = parse_scaled_int64(text, 9);
  constexpr std::int64_t kMax = 9'200'000'000'000'000'000;
  return ns && *ns <= kMax && *ns >= -kMax ? ns : std::nullopt;
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
