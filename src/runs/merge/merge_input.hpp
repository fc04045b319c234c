// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "gaussians/model/gaussians.hpp"
#include "map_io/map_file.hpp"
#include "mapping/training/trainer.hpp"
#include "runs/maps/posed_images.hpp"
#include "runs/run_config.hpp"

namespace apvi::runs {

/// A run with a map that is to be merged with others.
struct MergeSession {
  std::filesystem::path run;
  RunConfig config;
  map_io::MapFile map;
  Trajectory poses;               ///< body poses at the images of the map
  std::optional<double> psnr_db;  ///< of its own map
};

/// Reads the configuration, the map and the poses of a run. Throws InputError when it has none.
MergeSession load_merge_session(const std::filesystem::path& run);

/// The session with its poses replaced and its Gaussians moved with their nearest camera.
void move_session(MergeSession& session, const Trajectory& poses);

/// The sessions with their images, and the map to begin with.
struct JointMapping {
  std::vector<PosedImages> images;    ///< relative to the origin of the first map
  std::vector<torch::Tensor> lights;  ///< [3] of each session relative to the first
  gaussians::Gaussians initial;
};
/// Loads the images of all maps and puts the maps together (mapping::unite). Throws InputError for
/// a recording that cannot be read.
JointMapping load_joint_mapping(const std::vector<MergeSession>& sessions);

/// Of one session, with `iterations` for all. `joint` must outlive the training.
mapping::TrainingSession training_session(const MergeSession& session, JointMapping& joint,
                                          std::size_t index, int iterations);

}  // namespace apvi::runs
