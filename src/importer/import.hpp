// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "importer/assumed_camera.hpp"
#include "importer/image_encoder.hpp"

/// Makes data set folders of videos, photographs, models of COLMAP and Metashape, and vehicles'
/// logs.
namespace apvi::importer {

enum class SourceKind { video, photos, colmap, metashape, log };

struct ImportOptions {
  ImageOptions images;
  int every = 1;                  ///< video: use every n-th image
  double fps = 0.0;               ///< video: at most so many images per second; 0: no limit
  double start_s = 0.0;           ///< video: time skipped at the beginning
  double duration_s = 0.0;        ///< video: length used; 0: to the end
  std::optional<double> fov_deg;  ///< horizontal angle of view of the images, without distortion
  bool in_air = false;            ///< the images were not taken under water
  std::filesystem::path rig;      ///< calibration to use instead of an assumed one
  double meters_per_unit = 0.0;   ///< COLMAP, Metashape: scale; 0: unknown, or as Metashape has it
  std::filesystem::path
      image_folder;  ///< COLMAP, Metashape: where the images are; empty: looked for
  std::filesystem::path mask_folder;  ///< with named images: masks; see find_mask
  /// Video, log: files with samples of other sensors, see `read_sensor_files`.
  std::vector<std::filesystem::path> sensors;
  std::optional<Stamp> video_start;  ///< video: its first image's time, on the clock of `sensors`
  bool video_start_by_gyro = false;  ///< video: that time must be found by its rotation
  bool overwrite = false;
  std::function<bool()> interrupted = [] { return false; };
};

struct ImportResult {
  SourceKind kind = SourceKind::video;
  bool interrupted = false;  ///< nothing was written
  std::size_t images = 0;
  std::size_t imu_samples = 0;
  std::size_t dvl_samples = 0;
  std::size_t pressure_samples = 0;
  std::size_t poses = 0;
  std::size_t points = 0;
  bool has_metric_poses = false;  ///< the source says how long its unit is
  bool assumed_camera = false;    ///< no calibration was given
  double length_s = 0.0;
};

/// What an import has noted in its folder (import.yaml).
struct ImportNotes {
  std::string kind;  ///< "video", "photos", "colmap", "metashape", "log"
  std::size_t imu_samples = 0;
  std::size_t poses = 0;
  bool in_air = false;
};
/// nullopt for a folder that no import has made. Throws InputError when the file is damaged.
std::optional<ImportNotes> read_notes(const std::filesystem::path& folder);

/// What a path is: a video file, a folder of photographs, a COLMAP or Metashape model, a log of an
/// autopilot; nullopt for anything else (a data set, a bag, a configuration, nothing).
std::optional<SourceKind> source_kind(const std::filesystem::path& source);

/// Imports a source into the data set folder `out`, which is complete or absent afterwards. Throws
/// InputError for a source that cannot be read or an option that is not for its kind, RunError when
/// the folder cannot be written.
ImportResult import_source(const std::filesystem::path& source, const std::filesystem::path& out,
                           const ImportOptions& options);

}  // namespace apvi::importer
