// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "eval/metrics_file.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/rendering.hpp"
#include "runs/run_config.hpp"

namespace apvi::runs {

/// Compares the map with images all along a run with localization: every `eval.heldout_every`-th of
/// the recording, none of which is used for mapping, at most `mapping.online.max_heldout_views`,
/// rendered from where the run's path (`load_path`) leads from the nearest keyframe. Other than the
/// held-out keyframes these include images in the dark, in silt, and where visual odometry had
/// failed. `run` is the run folder.
///
/// Adds `all_images` to `json`: `psnr_db`, `images`, and the numbers of those `without_pose` and
/// `unreadable`. A recording that cannot be read again is logged and adds nothing.
void add_all_images(const mapping::Map& map, const mapping::KeyframeStore& keyframes,
                    const RunConfig& config, const std::filesystem::path& run, eval::Json& json);

}  // namespace apvi::runs
