// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

namespace apvi::runs {

/// Throws InputError, with what to do, unless two runs with maps are in one frame: one was found in
/// the map of the other, both were found in the map of a third one, or both have given poses.
void check_common_frame(const std::filesystem::path& before, const std::filesystem::path& after);

}  // namespace apvi::runs
