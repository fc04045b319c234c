// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "apvi/sim/scene_config.hpp"
#include "apvi/sim/simulation.hpp"

/// One writer per output format; see dataset_writer.hpp.
namespace apvi::sim {

/// Makes the folders above `path` and writes the file; RunError when that fails.
void write_below(const std::filesystem::path& path, const std::string& content);

/// The calibration that goes with the data, its pressure sensor as a depth sensor.
config::Node rig_with_depth(const Scene& scene);
/// What the pressure or depth sensor says, as depths.
std::vector<DepthSample> depths(const Scene& scene, const Recording& recording);

void write_folder(const std::filesystem::path& root, const Scene& scene,
                  const Recording& recording);
void write_euroc(const std::filesystem::path& root, const Scene& scene, const Recording& recording);
void write_tank(const std::filesystem::path& root, const Scene& scene, const Recording& recording);
void write_colmap(const std::filesystem::path& root, const Scene& scene,
                  const Recording& recording);
void write_bag(const std::filesystem::path& root, const Scene& scene, const Recording& recording);

}  // namespace apvi::sim
