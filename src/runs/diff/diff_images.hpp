// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <filesystem>
#include <string>

#include "change/change_map.hpp"
#include "runs/diff/diff_session.hpp"

namespace apvi::runs {

/// The name that the images of a change begin with: images/001_appeared.
std::string image_name(std::size_t index, change::Kind kind);

/// Writes NAME_before.png and NAME_after.png of a change below `folder`: both maps, drawn without
/// water from the view that shows it best.
void write_change_images(const std::filesystem::path& folder, std::size_t index,
                         const DiffSessions& sessions, const change::ChangeMap& map,
                         const DiffColors& colors);

/// Writes before.png, after.png and changes.png: the place from above, north up. In the last, what
/// appeared is green, what vanished red, other colors yellow, and what is not known in both dives
/// hatched. Returns its resolution [m].
double write_plan_images(const std::filesystem::path& folder, const DiffSessions& sessions,
                         const change::ChangeMap& map, const DiffColors& colors);

}  // namespace apvi::runs
