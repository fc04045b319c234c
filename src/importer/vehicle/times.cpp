// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/times.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <chrono>

#include "core/text.hpp"

namespace apvi::importer {

namespace chrono = std::chrono;

namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::int64_t kUnix2001_ns = 1'000'000'000 * kSecond_ns;

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

std::optional<chrono::seconds> take_date(std::string_view& text) {
  const auto y = take_digits(text, 4, '-');
  const auto m = y ? take_digits(text, 2, '-') : std::nullopt;
  const auto d = m ? take_digits(text, 2) : std::nullopt;
  if (!d || text.empty() || (text.front() != 'T' && text.front() != ' ')) return std::nullopt;
  text.remove_prefix(1);
  const chrono::year_month_day date{chrono::year(*y), chrono::month(static_cast<unsigned>(*m)),
                                    chrono::day(static_cast<unsigned>(*d))};
  if (!date.ok() || *y < 1970 || *y > 2100) return std::nullopt;
  return chrono::sys_days(date).time_since_epoch();
}

// "Z", "+02:00", "-0330" or nothing.
std::optional<chrono::seconds> zone_of(std::string_view text) {
  if (text.empty() || text == "Z" || text == "z") return chrono::seconds(0);
  const char sign = text.front();
  text.remove_prefix(1);
  if (sign != '+' && sign != '-') return std::nullopt;
  const auto h = take_digits(text, 2);
  if (text.starts_with(':')) text.remove_prefix(1);
  const auto m = h ? take_digits(text, 2) : std::nullopt;
  if (!m || !text.empty()) return std::nullopt;
  return (sign == '-' ? -1 : 1) * (chrono::hours(*h) + chrono::minutes(*m));
}

}  // namespace

std::optional<Stamp> parse_time(std::string_view text) {
  if (const auto ns = text::parse_seconds_as_ns(text)) {
    return *ns >= 0 ? std::optional(Stamp{*ns}) : std::nullopt;
  }
  const auto date = take_date(text);
  const auto h = date ? take_digits(text, 2, ':') : std::nullopt;
  const auto m = h ? take_digits(text, 2, ':') : std::nullopt;
  if (!m || *h > 23 || *m > 59) return std::nullopt;
  const std::size_t end = std::min(text.find_first_not_of("0123456789."), text.size());
  const auto second = text::parse_seconds_as_ns(text.substr(0, end));
  const auto zone = zone_of(text.substr(end));
  if (!second || !zone || *second < 0 || *second > 61 * kSecond_ns) return std::nullopt;
  const chrono::seconds whole = *date + chrono::hours(*h) + chrono::minutes(*m) - *zone;
  return Stamp{whole.count() * kSecond_ns + *second};
}

bool counts_from_1970(Stamp stamp) {
  return stamp.ns >= kUnix2001_ns;
}

std::string time_text(Stamp stamp) {
  if (!counts_from_1970(stamp)) return fmt::format("{:.3f} s", stamp.seconds());
  const std::int64_t ms = stamp.ns / 1'000'000;
  const chrono::sys_seconds whole{chrono::seconds(ms / 1000)};
  return fmt::format("{:%FT%T}.{:03}Z", fmt::gmtime(whole), ms % 1000);
}

}  // namespace apvi::importer
