// SPDX-License-Identifier: BSD-3-Clause
#include "core/date_time.hpp"

#include <algorithm>
#include <chrono>
#include <string>

#include "core/text.hpp"

namespace apvi {
namespace {

namespace chrono = std::chrono;

constexpr std::int64_t kSecond_ns = 1'000'000'000;

// Takes a number of exactly so many digits from the front of the text, and what follows it.
std::optional<int> take_digits(std::string_view& text, std::size_t count, char after = '\0') {
  int value = 0;
  if (text.size() < count) return std::nullopt;
  for (const char c : text.substr(0, count)) {
    if (c < '0' || c > '9') return std::nullopt;
    value = 10 * value + (c - '0');
  }
  text.remove_prefix(count);
  if (after == '\0') return value;
  if (!text.starts_with(after)) return std::nullopt;
  text.remove_prefix(1);
  return value;
}

// The separator between year and month, which is that between month and day; none in "20240501".
char date_separator(std::string_view text) {
  const char c = text.size() > 4 ? text[4] : '\0';
  return c == '-' || c == '/' ? c : '\0';
}

std::optional<chrono::seconds> take_date(std::string_view& text) {
  const char separator = date_separator(text);
  const auto y = take_digits(text, 4, separator);
  const auto m = y ? take_digits(text, 2, separator) : std::nullopt;
  const auto d = m ? take_digits(text, 2) : std::nullopt;
  const bool ends = text.empty() || (text.front() != 'T' && text.front() != 't' &&
                                     (text.front() != ' ' || separator == '\0'));
  if (!d || ends) return std::nullopt;
  text = text::trim(text.substr(1));
  const chrono::year_month_day date{chrono::year(*y), chrono::month(static_cast<unsigned>(*m)),
                                    chrono::day(static_cast<unsigned>(*d))};
  if (!date.ok() || *y < 1970 || *y > 2100) return std::nullopt;
  return chrono::sys_days(date).time_since_epoch();
}

std::optional<chrono::seconds> zone_of(std::string_view text) {
  text = text::trim(text);
  const std::string name = text::to_lower(text);
  if (name.empty() || name == "z" || name == "utc" || name == "gmt") return chrono::seconds(0);
  const char sign = text.front();
  text.remove_prefix(1);
  if (sign != '+' && sign != '-') return std::nullopt;
  const auto h = take_digits(text, 2);
  if (h && text.empty()) return (sign == '-' ? -1 : 1) * chrono::hours(*h);
  if (text.starts_with(':')) text.remove_prefix(1);
  const auto m = h ? take_digits(text, 2) : std::nullopt;
  if (!m || !text.empty()) return std::nullopt;
  return (sign == '-' ? -1 : 1) * (chrono::hours(*h) + chrono::minutes(*m));
}

}  // namespace

std::optional<Stamp> parse_date_time(std::string_view text) {
  text = text::trim(text);
  const auto date = take_date(text);
  if (!date) return std::nullopt;
  const char colon = text.size() > 2 && text[2] == ':' ? ':' : '\0';
  const auto h = take_digits(text, 2, colon);
  const auto m = h ? take_digits(text, 2, colon) : std::nullopt;
  if (!m || *h > 23 || *m > 59) return std::nullopt;
  const std::size_t end = std::min(text.find_first_not_of("0123456789.,"), text.size());
  std::string second(text.substr(0, end));
  if (const std::size_t comma = second.find(','); comma != std::string::npos) second[comma] = '.';
  const auto second_ns = text::parse_seconds_as_ns(second);
  const auto zone = zone_of(text.substr(end));
  if (!second_ns || !zone || *second_ns < 0 || *second_ns > 61 * kSecond_ns) return std::nullopt;
  const chrono::seconds whole = *date + chrono::hours(*h) + chrono::minutes(*m) - *zone;
  return Stamp{whole.count() * kSecond_ns + *second_ns};
}

}  // namespace apvi
