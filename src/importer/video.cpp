// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/videoio.hpp>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/status_line.hpp"
#include "importer/alignment/video_alignment.hpp"
#include "importer/gpmf.hpp"
#include "importer/matroska.hpp"
#include "importer/mp4.hpp"
#include "importer/sources.hpp"
#include "importer/vehicle/sensor_files.hpp"
#include "importer/vehicle/sensor_rig.hpp"
#include "importer/vehicle/video_sensors.hpp"
#include "importer/video_frames.hpp"

namespace apvi::importer {
namespace {

namespace fs = std::filesystem;

// What the file says beside its images.
struct VideoFile {
  Mp4Movie movie;
  std::optional<Telemetry> telemetry;
  double first_image_s = 0.0;  // on the clock of the telemetry
  std::optional<Stamp> created;
  SensorData sensors;  // of other devices
  Clock clock{kWithoutDate};
};

void read_index(const fs::path& path, VideoFile& file) {
  file.created = matroska_date(path);
  if (!is_mp4(path)) return;
  file.movie = read_mp4(path);
  if (const Mp4Track* video = file.movie.with_handler("vide")) {
    file.first_image_s = video->first_s();
  }
  file.telemetry = read_telemetry(path, file.movie);
  if (const auto seconds = file.movie.created_unix_s)
    file.created = Stamp{*seconds * 1'000'000'000};
}

std::optional<FieldOfView> recorded_field_of_view(const VideoFile& file) {
  const GpmfSettings settings = parse_gpmf_settings(file.movie.gpmf);
  std::string device = settings.device;
  if (device.empty() && file.telemetry) device = file.telemetry->device;
  return gopro_field_of_view(device, settings.field_of_view, settings.diagonal_deg);
}

VideoFile read_file(const fs::path& path, const ImportOptions& options) {
  VideoFile file;
  read_index(path, file);
  if (file.created) file.clock = {*file.created};
  if (options.sensors.empty()) return file;
  file.sensors = read_sensor_files(options.sensors);
  const Stamp start = video_start(path, file.created, file.sensors, options, [&] {
    return align_video(path, options, recorded_field_of_view(file), file.created, file.sensors.imu);
  });
  file.clock = {start - Duration::from_seconds(file.first_image_s)};
  return file;
}

// The IMU of the camera counts unless there is one of the vehicle.
bool has_imu(const VideoFile& file) {
  return file.telemetry && !file.telemetry->imu.empty() && file.sensors.imu.empty();
}

struct Images {
  ImageSize size;
  double last_s = 0.0;
  bool interrupted = false;
};

double total_frames(const cv::VideoCapture& video, const FrameClock& clock,
                    const ImportOptions& options) {
  const double all = video.get(cv::CAP_PROP_FRAME_COUNT);
  if (options.duration_s <= 0.0) return all;
  return std::min(all, clock.fps() * (options.start_s + options.duration_s));
}

Images write_images(cv::VideoCapture& video, const VideoFile& file, const ImportOptions& options,
                    DiveWriter& dive) {
  Images images;
  FrameClock clock(video);
  Selection selection(options);
  const double total = total_frames(video, clock, options);
  StatusLine status("reading images");
  cv::Mat image;
  for (double count = 1.0; video.grab(); ++count) {
    if (options.interrupted()) {
      images.interrupted = true;
      break;
    }
    const double time = clock.next();
    status.update(total > 0.0 ? std::min(1.0, count / total) : -1.0,
                  fmt::format("{} images, {:.1f} s", dive.images(), time));
    if (selection.past_end(time)) break;
    if (!selection.take(time) || !video.retrieve(image) || image.empty()) continue;
    const auto stamp = file.clock.at(time + file.first_image_s);
    if (!stamp || (dive.images() > 0 && *stamp <= dive.stamps().back())) continue;
    const ImageSize size = scaled(ImageSize{image.cols, image.rows}, options.images.scale);
    if (dive.images() > 0 && (size.width != images.size.width || size.height != images.size.height))
      continue;
    images.size = size;
    images.last_s = time;
    dive.add_image(*stamp, options.images.extension(), encode(image, options.images));
  }
  return images;
}

template <typename Row>
void restrict_to(std::vector<Row>& rows, double from_s, double to_s) {
  std::erase_if(rows, [&](const Row& r) { return r.time_s < from_s || r.time_s > to_s; });
}

// IMU and exposures of the images that were imported, with a second more on either side.
Telemetry telemetry_of(const VideoFile& file, const ImportOptions& options, double last_s) {
  constexpr double kMargin_s = 1.0;
  Telemetry telemetry = *file.telemetry;
  const double from = options.start_s + file.first_image_s - kMargin_s;
  const double to = last_s + file.first_image_s + kMargin_s;
  if (options.start_s > 0.0 || options.duration_s > 0.0) {
    restrict_to(telemetry.imu, from, to);
    restrict_to(telemetry.exposure, from, to);
  }
  return telemetry;
}

double rate_of(const std::vector<ImuRow>& rows) {
  const double span = rows.back().time_s - rows.front().time_s;
  const double rate = static_cast<double>(rows.size() - 1) / std::max(span, 1e-9);
  return std::clamp(rate, 1.0, 10000.0);
}

std::string imu_note(const Telemetry& telemetry) {
  const std::string device = telemetry.device.empty() ? "the camera" : telemetry.device;
  return fmt::format("IMU of {}; its noise is ASSUMED. The body frame is that of the camera",
                     device);
}

void warn_about_super_view(const VideoFile& file) {
  if (parse_gpmf_settings(file.movie.gpmf).field_of_view != "S") return;
  log::warning(
      "SuperView stretches images unevenly; no camera model fits them. Record in linear "
      "or wide mode");
}

void warn_about_rotation(const Telemetry& telemetry) {
  constexpr double kDegree = std::numbers::pi / 180.0;
  const double degrees = telemetry.image_rotation_rad / kDegree;
  if (degrees < 1.0) return;  // without stabilization it is a fraction of a degree
  log::warning(
      "images are turned against the camera by up to {:.1f} degrees (IORI), which the rig cannot "
      "describe; switch stabilization (HyperSmooth) and automatic rotation off",
      degrees);
}

// Writes what the camera recorded beside images; returns the section of its IMU in rig.yaml.
std::string write_telemetry(const VideoFile& file, const ImportOptions& options, double last_s,
                            DiveWriter& dive, ImportResult& result) {
  if (!file.telemetry) return "";
  warn_about_rotation(*file.telemetry);
  const Telemetry telemetry = telemetry_of(file, options, last_s);
  if (!telemetry.exposure.empty()) dive.write_exposure(telemetry.exposure, file.clock);
  if (!has_imu(file) || telemetry.imu.empty()) return "";
  result.imu_samples = telemetry.imu.size();
  dive.write_imu(telemetry.imu, file.clock);
  return imu_yaml(rate_of(telemetry.imu), imu_note(telemetry));
}

void write_other_sensors(VideoFile& file, DiveWriter& dive, ImportResult& result) {
  if (file.sensors.empty()) return;
  restrict_to_images(file.sensors, dive.stamps().front(), dive.stamps().back());
  write_sensors(file.sensors, dive);
  result.imu_samples = file.sensors.imu.size();
  result.dvl_samples = file.sensors.dvl.size();
  result.pressure_samples = file.sensors.pressure.size() + file.sensors.depth.size();
}

}  // namespace

ImportResult import_video(const fs::path& path, const ImportOptions& options, DiveWriter& dive) {
  ImportResult result;
  VideoFile file = read_file(path, options);
  cv::VideoCapture video = open_video(path, has_imu(file));
  const Images images = write_images(video, file, options, dive);
  result.interrupted = images.interrupted;
  if (result.interrupted || dive.images() == 0) return result;
  write_other_sensors(file, dive, result);
  warn_about_super_view(file);
  const BodyAxes assumed = body_axes(file.sensors, /*has_images=*/true);
  const CameraRig camera = make_camera_rig(options, recorded_field_of_view(file), images.size, dive,
                                           camera_pose(assumed));
  result.interrupted = options.interrupted();
  result.assumed_camera = camera.assumed;
  const std::string own_imu = write_telemetry(file, options, images.last_s, dive, result);
  const bool describes_imu = camera.given && camera.given->imu;
  const BodyAxes axes = camera.given ? body_axes(*camera.given) : assumed;
  if (!file.sensors.empty() && !camera.given) warn_of_mounting();
  dive.write_text("rig.yaml", sensor_yaml(file.sensors, axes, camera.given) +
                                  (describes_imu ? "" : own_imu) + camera.yaml);
  if (result.imu_samples == 0) log::info("{}: no IMU in this video", path.string());
  return result;
}

}  // namespace apvi::importer
