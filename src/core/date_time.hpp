// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string_view>

#include "apvi/core/stamp.hpp"

namespace apvi {

/// A date and time of ISO 8601: "2024-05-01T12:51:30.25Z". A blank may stand for the T, slashes for
/// the dashes, and a comma for the point. The zone is Z, UTC, GMT, +02:00, +0200, +02 or nothing,
/// which is UTC; "20240501T125130Z" is fine as well. nullopt for anything else.
std::optional<Stamp> parse_date_time(std::string_view text);

}  // namespace apvi
