// SPDX-License-Identifier: BSD-3-Clause
#include "importer/import.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <system_error>

#include "apvi/config/node.hpp"
#include "apvi/core/error.hpp"
#include "core/foreign_file.hpp"
#include "core/text.hpp"
#include "importer/mp4.hpp"
#include "importer/sources.hpp"
#include "importer/vehicle/sensor_files.hpp"

namespace apvi::importer {
namespace {

namespace fs = std::filesystem;

bool has_video_extension(const fs::path& path) {
  const std::string extension = text::to_lower(path.extension().string());
  const auto known = {".mp4", ".mov",  ".m4v", ".360",  ".lrv", ".avi", ".mkv",
                      ".mpg", ".mpeg", ".mts", ".m2ts", ".wmv", ".webm"};
  return std::find(known.begin(), known.end(), extension) != known.end();
}

std::optional<SourceKind> folder_kind(const fs::path& folder) {
  for (const char* data_set : {"mav0", "IMG_L", "imu.csv", "metadata.yaml"}) {
    if (fs::exists(folder / data_set)) return std::nullopt;
  }
  if (find_colmap_model(folder)) return SourceKind::colmap;
  if (find_metashape_cameras(folder)) return SourceKind::metashape;
  if (!list_photos(folder).empty()) return SourceKind::photos;
  return std::nullopt;
}

const char* name_of(SourceKind kind) {
  switch (kind) {
    case SourceKind::video:
      return "video";
    case SourceKind::photos:
      return "photos";
    case SourceKind::colmap:
      return "colmap";
    case SourceKind::metashape:
      return "metashape";
    case SourceKind::log:
      return "log";
  }
  return "";
}

config::Node scalar(const std::string& text) {
  config::Node node;
  node.kind = config::Node::Kind::scalar;
  node.text = text;
  return node;
}

void write_notes(const fs::path& source, const ImportOptions& options, const ImportResult& result,
                 DiveWriter& dive) {
  const bool metric = result.imu_samples + result.dvl_samples + result.pressure_samples > 0 ||
                      options.meters_per_unit > 0.0 || result.has_metric_poses;
  config::Node notes;
  notes.member("source") = scalar(fs::absolute(source).lexically_normal().string());
  notes.member("kind") = scalar(name_of(result.kind));
  notes.member("images") = scalar(std::to_string(result.images));
  notes.member("imu_samples") = scalar(std::to_string(result.imu_samples));
  notes.member("poses") = scalar(std::to_string(result.poses));
  notes.member("calibration") = scalar(result.assumed_camera ? "assumed" : "given");
  notes.member("medium") = scalar(options.in_air ? "air" : "water");
  notes.member("scale") = scalar(metric ? "known" : "unknown");
  dive.write_text(kImportNotes, config::to_yaml(notes));
}

ImportResult import_kind(SourceKind kind, const fs::path& source, const ImportOptions& options,
                         DiveWriter& dive) {
  switch (kind) {
    case SourceKind::video:
      return import_video(source, options, dive);
    case SourceKind::photos:
      return import_photos(source, options, dive);
    case SourceKind::colmap:
      return import_colmap(source, options, dive);
    case SourceKind::metashape:
      return import_metashape(source, options, dive);
    case SourceKind::log:
      return import_log(source, options, dive);
  }
  return {};
}

void check(const ImportOptions& options) {
  if (!(options.images.scale > 0.0 && options.images.scale <= 1.0)) {
    fail_input("--scale: {}; must be above 0 and at most 1", options.images.scale);
  }
  if (options.every < 1) fail_input("--every: {}; must be at least 1", options.every);
  if (options.fps < 0.0) fail_input("--fps: {}; must not be negative", options.fps);
}

void check_sensors(SourceKind kind, const ImportOptions& o) {
  if (kind != SourceKind::video && kind != SourceKind::log && !o.sensors.empty())
    fail_input("--sensors: only for a video or a log");
  const bool has_start = o.video_start || o.video_start_by_gyro;
  if (has_start && (kind != SourceKind::video || o.sensors.empty())) {
    fail_input("--video-start: only for a video with --sensors");
  }
  const bool of_images = o.fov_deg || o.in_air || o.images.scale < 1.0 || o.images.png;
  if (kind == SourceKind::log && (of_images || !o.mask_folder.empty())) {
    fail_input("--fov, --in-air, --scale, --png, --masks: not for a log, which has no images");
  }
}

// An option without effect is a mistake.
void check_kind(SourceKind kind, const ImportOptions& o) {
  check_sensors(kind, o);
  const bool selects = o.every > 1 || o.fps > 0.0 || o.start_s > 0.0 || o.duration_s > 0.0;
  if (kind != SourceKind::video && selects) {
    fail_input("--every, --fps, --from, --length: only for a video");
  }
  if (kind == SourceKind::video && !o.mask_folder.empty()) {
    fail_input("--masks: not for a video, whose images have no names");
  }
  const bool posed = kind == SourceKind::colmap || kind == SourceKind::metashape;
  if (!posed && (o.meters_per_unit > 0.0 || !o.image_folder.empty())) {
    fail_input("--meters-per-unit, --images: only for a COLMAP or Metashape model");
  }
  if (posed && (o.fov_deg || !o.rig.empty())) {
    fail_input("--fov, --rig: not for a COLMAP or Metashape model, which has its own calibration");
  }
}

std::string value_of(const config::Node& notes, const char* key) {
  const config::Node* node = notes.find(key);
  return node == nullptr ? "" : node->text;
}

std::size_t count_of(const config::Node& notes, const char* key) {
  const auto count = text::parse_int64(value_of(notes, key));
  return count && *count > 0 ? static_cast<std::size_t>(*count) : 0;
}

}  // namespace

std::optional<ImportNotes> read_notes(const fs::path& folder) {
  if (!fs::exists(folder / kImportNotes)) return std::nullopt;
  const config::Node notes = config::load_file(folder / kImportNotes);
  return ImportNotes{.kind = value_of(notes, "kind"),
                     .imu_samples = count_of(notes, "imu_samples"),
                     .poses = count_of(notes, "poses"),
                     .in_air = value_of(notes, "medium") == "air"};
}

std::optional<SourceKind> source_kind(const fs::path& source) {
  std::error_code ignored;
  if (fs::is_directory(source, ignored)) return folder_kind(source);
  if (!fs::is_regular_file(source, ignored)) return std::nullopt;
  if (has_video_extension(source) || is_mp4(source)) return SourceKind::video;
  if (find_metashape_cameras(source)) return SourceKind::metashape;
  if (is_vehicle_log(source)) return SourceKind::log;
  return std::nullopt;
}

ImportResult import_source(const fs::path& source, const fs::path& out,
                           const ImportOptions& options) {
  check(options);
  if (!fs::exists(source)) fail_input("{}: no such file or folder", source.string());
  const auto kind = source_kind(source);
  if (!kind) {
    const auto foreign = describe_foreign_file(source);
    if (foreign) fail_input("{}: cannot be imported: {}", source.string(), *foreign);
    if (fs::is_directory(source) && fs::is_empty(source)) {
      fail_input("{}: this folder is empty", source.string());
    }
    fail_input(
        "{}: not a video, no folder of JPEG or PNG images, no COLMAP or Metashape model, no log of "
        "an autopilot",
        source.string());
  }
  check_kind(*kind, options);
  try {
    DiveWriter dive(out, options.overwrite);
    ImportResult result = import_kind(*kind, source, options, dive);
    result.kind = *kind;
    result.images = dive.images();
    if (result.interrupted) return result;
    if (result.images > 0) {
      result.length_s = seconds_between(dive.stamps().front(), dive.stamps().back());
    } else if (*kind != SourceKind::log) {
      fail_input("{}: no image in it", source.string());
    }
    write_notes(source, options, result, dive);
    dive.finish();
    return result;
  } catch (const fs::filesystem_error& e) {
    fail_run("{}: {}", e.path1().string(), e.code().message());
  }
}

}  // namespace apvi::importer
