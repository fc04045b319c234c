// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "gaussians/render/tone_curve.hpp"
#include "map_io/origin.hpp"
#include "mapping/blocks/block_partition.hpp"
#include "medium/vignetting.hpp"

namespace apvi::runs {

/// A training image of a refinement.
struct RefineImage {
  Stamp image;    ///< its own stamp
  Stamp taken;    ///< that of its pose in the run's keyframes.tum
  int owner = 0;  ///< block that it shows most of, whose pose and gain for it are kept
};

struct RefineBlock {
  std::vector<std::size_t> images;  ///< that show it, ascending
  std::vector<int> neighbors;       ///< blocks that these images show too, and itself, ascending
};

/// What a refinement consists of: rounds of tasks, one for each block. Tasks of one round are
/// independent of each other and of the process that carries them out.
struct RefinePlan {
  std::filesystem::path run;  ///< absolute path of the run whose map is refined
  int rounds = 1;
  int steps_per_image = 1;  ///< in all rounds together
  int max_gaussians = 0;    ///< of a task; 0: the default of its device
  mapping::BlockPartition partition;
  medium::Vignetting vignetting;
  gaussians::ToneCurve tone_curve;
  map_io::Origin origin{};
  std::vector<RefineImage> images = {};  ///< in the order of time
  std::vector<RefineBlock> blocks = {};
};

/// Files of a refinement in its run folder: FOLDER/refine/...
std::filesystem::path refine_folder(const std::filesystem::path& folder);
std::filesystem::path plan_file(const std::filesystem::path& folder);
/// The map that the first round starts from.
std::filesystem::path initial_map_file(const std::filesystem::path& folder);

/// The part of a plan that one process carries out at a time.
struct RefineTask {
  int round = 0;
  int block = 0;
};
/// FOLDER/refine/roundR_blockB`ending`, counted from 1.
std::filesystem::path task_file(const std::filesystem::path& folder, const RefineTask& task,
                                const char* ending);
/// Where the result of a task is when it has finished.
std::filesystem::path result_file(const std::filesystem::path& folder, const RefineTask& task);

/// Atomic. Throws RunError when it cannot be written.
void write_plan(const std::filesystem::path& folder, const RefinePlan& plan);
/// Throws InputError when there is none, or a damaged one.
RefinePlan read_plan(const std::filesystem::path& folder);

}  // namespace apvi::runs
