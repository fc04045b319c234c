// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <vector>

namespace apvi::runs {

struct MergeRequest {
  std::vector<std::filesystem::path> runs;  ///< at least two, each with a map
  std::filesystem::path folder;
  int iterations = 0;  ///< 0: ten for every training image
  int threads = 0;     ///< 0: as the first run
  /// The runs have one frame: poses are taken as they are.
  bool same_frame = false;
  bool overwrite = false;
  bool resume = false;  ///< from the folder's checkpoint.pt, if it exists
  std::function<bool()> interrupted = [] { return false; };  ///< polled after every iteration
};

struct MergeResult {
  bool interrupted = false;
  std::int64_t iterations = 0;
  std::int64_t gaussians = 0;
  double wall_s = 0.0;
  std::vector<double> psnr_db;  ///< of each session's held-out images; NaN when there are none
};

/// The folder of session `index` in the folder of a merged map: that itself for the first, then
/// session2, session3, ...
std::filesystem::path session_folder(const std::filesystem::path& folder, std::size_t index);

/// Joins the maps of several dives at one place into one set of Gaussians in the frame of the first
/// run: one pose graph over the keyframes of all, then a joint optimization in which every session
/// has its own water, light and camera response. Writes the folder of a run for each session (see
/// session_folder) with the same Gaussians in its light and water, its poses and its held-out
/// images, and the section `sessions` of the first one's metrics.json. Results so far are in the
/// folder even when this is interrupted. Throws InputError for runs that cannot be joined, RunError
/// when something cannot be written.
MergeResult merge_runs(const MergeRequest& request);

}  // namespace apvi::runs
