// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>

#include "change/change_map.hpp"

namespace apvi::runs {

/// A change map to make of two runs.
struct DiffRequest {
  std::filesystem::path before, after;  ///< run folders with maps
  std::filesystem::path out;            ///< folder
  change::Options options{};
  bool same_frame = false;  ///< do not check that the runs have one frame
  bool overwrite = false;   ///< replace an earlier change map
  std::function<bool()> interrupted = [] { return false; };
};

/// What was found, for messages.
struct DiffSummary {
  std::size_t appeared = 0, vanished = 0, color = 0;
  double compared_m2 = 0.0, unknown_m2 = 0.0;
};

/// Compares the maps of two runs, see change::find_changes, and writes changes.json, changes.csv,
/// changes.ply, before.png, after.png, changes.png and images/ into `out`; docs/formats.md
/// describes them. Everything is written next to `out` first, so that an interruption leaves
/// nothing unfinished. Throws InputError for invalid input, RunError when interrupted or when
/// something cannot be written.
DiffSummary diff_runs(const DiffRequest& request);

}  // namespace apvi::runs
