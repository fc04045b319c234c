// SPDX-License-Identifier: BSD-3-Clause
#include "cli/import_support.hpp"

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/interrupt.hpp"
#include "importer/vehicle/times.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

constexpr const char* kGroup =
    "Import of a video, photographs, a COLMAP or Metashape model, or a log";

void add_selection(CLI::App& command, importer::ImportOptions& options) {
  command.add_option("--every", options.every, "video: use every n-th image")
      ->check(CLI::PositiveNumber)
      ->type_name("N")
      ->group(kGroup);
  command.add_option("--fps", options.fps, "video: at most so many images per second")
      ->check(CLI::PositiveNumber)
      ->type_name("RATE")
      ->group(kGroup);
  command.add_option("--from", options.start_s, "video: time skipped at the beginning")
      ->check(CLI::NonNegativeNumber)
      ->type_name("SECONDS")
      ->group(kGroup);
  command.add_option("--length", options.duration_s, "video: length used (default: to the end)")
      ->check(CLI::PositiveNumber)
      ->type_name("SECONDS")
      ->group(kGroup);
  command.add_option("--scale", options.images.scale, "scale of the images' width and height")
      ->check(CLI::Range(0.01, 1.0))
      ->type_name("FACTOR")
      ->group(kGroup);
  command.add_flag("--png", options.images.png, "store PNG, not JPEG")->group(kGroup);
}

void add_calibration(CLI::App& command, importer::ImportOptions& options) {
  command
      .add_option_function<double>(
          "--fov", [&options](double degrees) { options.fov_deg = degrees; },
          "video, photographs: horizontal angle of view, as seen where they were taken")
      ->check(CLI::Range(5.0, 150.0))
      ->type_name("DEGREES")
      ->group(kGroup);
  command.add_flag("--in-air", options.in_air, "the images were not taken under water")
      ->group(kGroup);
  command
      .add_option("--rig", options.rig,
                  "video, photographs: rig.yaml to use; its resolution is that after --scale")
      ->type_name("FILE")
      ->group(kGroup);
  command
      .add_option("--meters-per-unit", options.meters_per_unit,
                  "COLMAP, Metashape: length of the model's unit; without it the scale of COLMAP "
                  "is unknown")
      ->check(CLI::PositiveNumber)
      ->type_name("METERS")
      ->group(kGroup);
  command
      .add_option("--masks", options.mask_folder,
                  "photographs, COLMAP, Metashape: folder of masks named as the images, black "
                  "where they do "
                  "not show the scene")
      ->type_name("FOLDER")
      ->group(kGroup);
  command.add_option("--images", options.image_folder, "COLMAP, Metashape: folder of the images")
      ->type_name("FOLDER")
      ->group(kGroup);
}

void take_video_start(const std::string& text, importer::ImportOptions& options) {
  options.video_start_by_gyro = text == "gyro";
  options.video_start = importer::parse_time(text);
  if (options.video_start || options.video_start_by_gyro) return;
  fail_input(
      "--video-start: {}: not a time; write seconds since 1970, such as 1714567890.25, a date and "
      "time, such as 2024-05-01T12:51:30.25Z, or gyro",
      text);
}

void add_sensors(CLI::App& command, importer::ImportOptions& options) {
  command
      .add_option("--sensors", options.sensors,
                  "video, log: file with samples of other sensors: csv with the columns of a data "
                  "set folder, log of a Water Linked DVL (.jsonl), of an autopilot (.tlog, .BIN); "
                  "repeatable")
      ->type_name("FILE")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->group(kGroup);
  command
      .add_option_function<std::string>(
          "--video-start", [&options](const std::string& text) { take_video_start(text, options); },
          "video with --sensors: time of its first image on the sensors' clock: seconds, or date "
          "and time (UTC without a zone); gyro: where the rotation of the images fits that of the "
          "IMU, else an error")
      ->type_name("TIME|gyro")
      ->group(kGroup);
}

}  // namespace

void add_import_options(CLI::App& command, importer::ImportOptions& options) {
  add_selection(command, options);
  add_calibration(command, options);
  add_sensors(command, options);
}

void import_into(const fs::path& source, const fs::path& folder, importer::ImportOptions options) {
  const InterruptGuard guard;
  options.interrupted = [&guard] { return guard.interrupted(); };
  const importer::ImportResult result = importer::import_source(source, folder, options);
  if (result.interrupted) fail_run("interrupted; {} was not written", folder.string());
  log::info("{}: {} images of {:.1f} s, samples: {} IMU, {} DVL, {} pressure; {} poses, {} points",
            folder.string(), result.images, result.length_s, result.imu_samples, result.dvl_samples,
            result.pressure_samples, result.poses, result.points);
}

std::vector<std::string> overrides_of_import(const fs::path& folder) {
  std::vector<std::string> overrides;
  const auto notes = importer::read_notes(folder);
  if (!notes) return overrides;
  if (notes->in_air) overrides.emplace_back("mapping.medium=false");
  if (notes->poses == 0) return overrides;
  overrides.emplace_back("localization.enabled=false");
  const fs::path points = folder / "points3D.txt";
  if (fs::exists(points)) overrides.push_back("mapping.initial_points=" + points.string());
  return overrides;
}

}  // namespace apvi::cli
