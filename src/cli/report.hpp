// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

namespace apvi::cli {

/// Writes report.html into a run folder by the report script. A report is optional: without Python
/// or its packages there is none, with a warning.
void write_report(const std::filesystem::path& folder);

}  // namespace apvi::cli
