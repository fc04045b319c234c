// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "apvi/core/stamp.hpp"

namespace apvi::importer {

/// A time as seconds ("1714567890.25") or as an ISO date and time ("2024-05-01T12:51:30.25Z", with
/// Z, +02:00 or nothing for UTC). nullopt for anything else.
std::optional<Stamp> parse_time(std::string_view text);

/// Whether a clock that shows this time counts from 1970, and not from when a device was started.
bool counts_from_1970(Stamp stamp);

/// "2024-05-01T12:51:30.250Z"; for clocks that do not count from 1970, "12.250 s".
std::string time_text(Stamp stamp);

}  // namespace apvi::importer
