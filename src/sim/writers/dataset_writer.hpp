// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "sim/scene_config.hpp"
#include "sim/simulation.hpp"
#include "sim/spectral/development.hpp"

/// Writes the files of a simulated recording in the layouts that the readers support.
namespace apvi::sim {

/// folder: this project's dataset folder; euroc: as published, with a sensor.yaml per sensor;
/// rosbag: a ROS 1 bag with the topics of the Tank dataset; tank: its raw folder; colmap: images
/// and a text model with the ground-truth poses.
enum class OutputFormat { folder, euroc, rosbag, tank, colmap };

/// ".jpg" for a camera that stores JPEG (spectral.jpeg_quality), else ".png".
std::string_view image_extension(const SceneConfig& config);

/// Path of a frame below the dataset folder. Frames for a bag are kept in `frames` until the bag is
/// written.
std::filesystem::path image_path(const std::filesystem::path& root, OutputFormat format,
                                 std::size_t camera, Stamp stamp, std::string_view extension);

/// Writes everything except images and ground truth: the sensor files and calibration of the
/// format. For `rosbag` and `colmap` the frames must exist. Throws RunError when a file cannot be
/// written.
void write_recording(const std::filesystem::path& root, OutputFormat format, const Scene& scene,
                     const Recording& recording);

/// Writes mav0/exposure0/data.csv, what the camera reports of its exposures: shutter time, ISO (100
/// times the gain) and white balance of every frame. Nothing without `exposures`.
void write_exposures(const std::filesystem::path& root, const Scene& scene,
                     const Recording& recording, const std::vector<Development>& exposures);

/// Writes truth/: rig.yaml, events.csv, trajectory.tum, objects.json, mesh.ply (if requested), and
/// medium.json from the per-frame files in truth/medium, or from the scene when there are none;
/// with spectral physics also camera.json.
void write_truth(const std::filesystem::path& root, const Scene& scene, const EventSchedule& events,
                 const Recording& recording, const TriangleMesh& mesh);

}  // namespace apvi::sim
