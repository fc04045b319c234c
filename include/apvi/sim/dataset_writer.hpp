// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "apvi/sim/scene_config.hpp"
#include "apvi/sim/simulation.hpp"

/// Files of a simulated recording, in the layouts that readers know.
namespace apvi::sim {

/// folder: this project's data set folder; euroc: as published, with a sensor.yaml per sensor;
/// rosbag: a ROS 1 bag with the topics of the Tank data set; tank: its raw folder; colmap: images
/// and a text model of the true poses.
enum class OutputFormat { folder, euroc, rosbag, tank, colmap };

/// Where a frame belongs below the data set's folder. Frames for a bag are kept in `frames` until
/// the bag is written.
std::filesystem::path image_path(const std::filesystem::path& root, OutputFormat format,
                                 std::size_t camera, Stamp stamp);

/// Writes everything but pictures and truth: sensor files and calibration of the format; for
/// `rosbag` and `colmap` the frames must be there. Throws RunError when a file cannot be written.
void write_recording(const std::filesystem::path& root, OutputFormat format, const Scene& scene,
                     const Recording& recording);

/// truth/: rig.yaml, events.csv, trajectory.tum, mesh.ply (when the scene asks for it), and
/// medium.json from the files that the frames left in truth/medium, or from the scene when there
/// are none.
void write_truth(const std::filesystem::path& root, const Scene& scene, const EventSchedule& events,
                 const Recording& recording, const TriangleMesh& mesh);

}  // namespace apvi::sim
