// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/times.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <chrono>

#include "core/date_time.hpp"
#include "core/text.hpp"

namespace apvi::importer {

namespace chrono = std::chrono;

namespace {

constexpr std::int64_t kUnix2001_ns = 1'000'000'000'000'000'000;

}  // namespace

std::optional<Stamp> parse_time(std::string_view text) {
  if (const auto ns = text::parse_seconds_as_ns(text)) {
    return *ns >= 0 ? std::optional(Stamp{*ns}) : std::nullopt;
  }
  return parse_date_time(text);
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
