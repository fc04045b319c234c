// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/video_sensors.hpp"

#include <array>
#include <cmath>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "importer/alignment/video_alignment.hpp"
#include "importer/vehicle/times.hpp"

namespace apvi::importer {

namespace {

namespace fs = std::filesystem;

// A camera's clock is hardly ever right, but more than this is a wrong date or another time zone.
void compare_with_creation(const fs::path& video, Stamp created, Stamp start) {
  const double late_s = seconds_between(start, created);
  if (!counts_from_1970(start) || std::abs(late_s) <= kCameraClockError_s) return;
  log::warning(
      "{}: the file says that it was created at {}, {:.1f} h {} than the images fit the sensors: a "
      "wrong clock or time zone of the camera, or sensors of another dive",
      video.string(), time_text(created), std::abs(late_s) / 3600.0,
      late_s > 0.0 ? "later" : "earlier");
}

Stamp start_by_gyro(const fs::path& video, std::optional<Stamp> created,
                    const GyroAlignment& found) {
  log::info(
      "{}: begins at {} on the sensors' clock, where its rotation fits that of the gyro (sigma "
      "{:.3f} s; correlation {:.2f}, at other times up to {:.2f})",
      video.string(), time_text(*found.start), found.sigma_s, found.correlation, found.elsewhere);
  if (created) compare_with_creation(video, *created, *found.start);
  return *found.start;
}

}  // namespace

Stamp video_start(const fs::path& video, std::optional<Stamp> created, const SensorData& sensors,
                  const ImportOptions& options, const std::function<GyroAlignment()>& by_gyro) {
  if (options.video_start) return *options.video_start;
  std::string without_gyro = "the sensors have no gyro";
  if (!sensors.imu.empty()) {
    const GyroAlignment found = by_gyro();
    if (found.start) return start_by_gyro(video, created, found);
    without_gyro = "its rotation does not tell when it begins: " + found.why_not;
  }
  if (options.video_start_by_gyro && !options.interrupted()) {
    fail_input("{}: {}; give the time of its first image on the sensors' clock with --video-start",
               video.string(), without_gyro);
  }
  const auto [first, last] = *sensors.span();
  if (created && *created >= first && *created <= last) {
    log::info(
        "{}: begins at {} on the sensors' clock, when the file says it was created ({}); give "
        "--video-start if images and sensors do not fit",
        video.string(), time_text(*created), without_gyro);
    return *created;
  }
  log::warning(
      "{}: {}, and the sensors are from {} to {}; {}; ASSUMED that the first image is from when "
      "the sensors begin; give its time on their clock with --video-start",
      video.string(), created ? "created " + time_text(*created) : "has no date", time_text(first),
      time_text(last), without_gyro);
  return first;
}

void restrict_to_images(SensorData& sensors, Stamp first, Stamp last) {
  const Duration margin = Duration::from_seconds(5.0);  // the estimators begin before the images
  const auto [from, to] = *sensors.span();
  const auto present = [&sensors] {
    return std::array{!sensors.imu.empty(), !sensors.dvl.empty(), !sensors.pressure.empty(),
                      !sensors.depth.empty()};
  };
  constexpr std::array kNames = {"imu0", "dvl0", "pressure0", "depth0"};
  const auto before = present();
  sensors.restrict_to(first - margin, last + margin);
  if (sensors.empty()) {
    fail_input(
        "--sensors: from {} to {}, but the images are from {} to {}; give the time of the video's "
        "first image on the sensors' clock with --video-start",
        time_text(from), time_text(to), time_text(first), time_text(last));
  }
  const auto after = present();
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if (before[i] && !after[i]) {
      log::warning("{}: no samples while the video was recorded", kNames[i]);
    }
  }
}

void warn_of_mounting() {
  log::warning(
      "rig.yaml: the mounting of camera and sensors is ASSUMED: the camera looks forward, all are "
      "at one place; correct it there, or give --rig; `apvi doctor` checks it");
}

}  // namespace apvi::importer
