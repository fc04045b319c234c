// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "change/change_map.hpp"
#include "runs/diff/diff_session.hpp"

namespace apvi::runs {

/// What changes.json says besides the changes.
struct DiffHeader {
  std::filesystem::path before, after;  ///< the runs
  double min_size_m = 0.0;
  double plan_m = 0.0;  ///< size of a pixel of the images from above
};

/// Writes changes.json, changes.csv and changes.ply into `folder`, in the coordinates of the
/// recording.
void write_change_files(const std::filesystem::path& folder, const DiffHeader& header,
                        const DiffSessions& sessions, const change::ChangeMap& map,
                        const DiffColors& colors);

}  // namespace apvi::runs
