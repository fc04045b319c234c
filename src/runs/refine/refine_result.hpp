// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <filesystem>
#include <map>
#include <vector>

#include "gaussians/model/gaussians.hpp"

namespace apvi::runs {

/// What a task of a refinement has made of its block; on the CPU.
struct RefineResult {
  gaussians::Gaussians gaussians;            ///< with positions in the block
  std::vector<std::int64_t> stamps_ns = {};  ///< of the images that the block owns
  torch::Tensor poses = {};                  ///< [n,4,4] float64 T_camera_world of these
  torch::Tensor log_gains = {};              ///< [n]
  torch::Tensor illumination = {};           ///< [n,3,rows,columns]; undefined: not estimated
  std::int64_t steps = 0;                    ///< of the block so far, in all rounds
  double seconds = 0.0;                      ///< in these
};

/// Atomic. Throws RunError when it cannot be written.
void write_result(const std::filesystem::path& file, const RefineResult& result);
/// Throws InputError when it is damaged.
RefineResult read_result(const std::filesystem::path& file);

/// Row of each image by its stamp [ns].
std::map<std::int64_t, std::int64_t> rows_by_stamp(const RefineResult& result);

/// Results of several blocks put together, in the order given.
RefineResult join(std::vector<RefineResult> results);

}  // namespace apvi::runs
