// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Text to numbers and back without locale, allocation or exceptions.
namespace apvi::text {

/// The text without white space (and '\r') at either end.
std::string_view trim(std::string_view text);
/// The parts between separators, trimmed; "a,,b" has three, "" has one empty part.
void split(std::string_view line, char separator, std::vector<std::string_view>& parts);
/// The whole text as a number; nothing when anything else is in it. Takes "nan" and "inf".
std::optional<double> parse_double(std::string_view text);
std::optional<std::int64_t> parse_int64(std::string_view text);
/// Decimal seconds ("1403636580.838555574") as nanoseconds, exact: no detour over a double.
std::optional<std::int64_t> parse_seconds_as_ns(std::string_view text);
std::string to_lower(std::string_view text);
/// The candidate closest to `word` by edit distance, if it is close enough to be a typo of it.
std::optional<std::string> closest(std::string_view word,
                                   const std::vector<std::string>& candidates);

}  // namespace apvi::text
