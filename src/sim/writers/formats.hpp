// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "sim/scene_config.hpp"
#include "sim/simulation.hpp"

/// One writer per output format; see dataset_writer.hpp.
namespace apvi::sim {

/// Creates the parent folders of `path` and writes the file. Throws RunError on failure.
void write_file(const std::filesystem::path& path, const std::string& content);

/// The (possibly perturbed) calibration with the pressure sensor replaced by a depth sensor.
config::Node rig_with_depth(const Scene& scene);
/// Samples of the pressure or depth sensor, as depths.
std::vector<PressureDepthSample> depth_samples(const Scene& scene, const Recording& recording);

/// truth/objects.json: what the scene places by hand, in the world `mesh`.
std::string objects_json(const WorldConfig& world, std::uint64_t seed, const TriangleMesh& mesh);

void write_folder(const std::filesystem::path& root, const Scene& scene,
                  const Recording& recording);
void write_euroc(const std::filesystem::path& root, const Scene& scene, const Recording& recording);
void write_tank(const std::filesystem::path& root, const Scene& scene, const Recording& recording);
void write_colmap(const std::filesystem::path& root, const Scene& scene,
                  const Recording& recording);
void write_bag(const std::filesystem::path& root, const Scene& scene, const Recording& recording);

}  // namespace apvi::sim
