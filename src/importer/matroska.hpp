// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>

#include "apvi/core/stamp.hpp"

namespace apvi::importer {

/// When a Matroska or WebM file was created (DateUTC of its Info, RFC 9559). nullopt for other
/// files and for those without a date. Never throws.
std::optional<Stamp> matroska_date(const std::filesystem::path& path);

}  // namespace apvi::importer
