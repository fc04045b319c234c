// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Locale-independent text parsing without exceptions.
namespace apvi::text {

/// The text without leading and trailing white space (including '\r').
std::string_view trim(std::string_view text);
/// The text without a leading UTF-8 byte order mark, as Windows programs write it.
std::string_view without_byte_order_mark(std::string_view text);
/// The parts between separators, trimmed; "a,,b" has three, "" has one empty part.
void split(std::string_view line, char separator, std::vector<std::string_view>& parts);
/// The entire text as a number; nullopt for anything else. Accepts "nan" and "inf".
std::optional<double> parse_double(std::string_view text);
std::optional<std::int64_t> parse_int64(std::string_view text);
/// A decimal number times 10^power ("1.4e18", "17.0"), rounded to a whole number without passing
/// through a double; nullopt when it does not fit.
std::optional<std::int64_t> parse_scaled_int64(std::string_view text, int power);
/// Decimal seconds ("1403636580.838555574") as exact nanoseconds, not rounded through a double.
std::optional<std::int64_t> parse_seconds_as_ns(std::string_view text);
std::string to_lower(std::string_view text);
/// The candidate with the smallest edit distance to `word`, if small enough to be a typo.
std::optional<std::string> closest_match(std::string_view word,
                                         const std::vector<std::string>& candidates);

}  // namespace apvi::text
