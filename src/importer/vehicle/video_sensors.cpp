// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/video_sensors.hpp"

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "importer/vehicle/times.hpp"

namespace apvi::importer {

Stamp video_start(const std::filesystem::path& video, std::optional<Stamp> created,
                  const SensorData& sensors, const ImportOptions& options) {
  if (options.video_start) return *options.video_start;
  const auto [first, last] = *sensors.span();
  if (created && *created >= first && *created <= last) {
    log::info(
        "{}: begins at {} on the sensors' clock, when the file says it was created; give "
        "--video-start if images and sensors do not fit",
        video.string(), time_text(*created));
    return *created;
  }
  log::warning(
      "{}: {}, and the sensors are from {} to {}; ASSUMED that the first image is from when the "
      "sensors begin; give its time on their clock with --video-start",
      video.string(), created ? "created " + time_text(*created) : "has no date", time_text(first),
      time_text(last));
  return first;
}

void restrict_to_images(SensorData& sensors, Stamp first, Stamp last) {
  const Duration margin = Duration::from_seconds(5.0);  // the estimators begin before the images
  const auto [from, to] = *sensors.span();
  const SensorData all = sensors;
  sensors.restrict_to(first - margin, last + margin);
  if (sensors.empty()) {
    fail_input(
        "--sensors: from {} to {}, but the images are from {} to {}; give the time of the video's "
        "first image on the sensors' clock with --video-start",
        time_text(from), time_text(to), time_text(first), time_text(last));
  }
  const auto check = [](const char* sensor, const auto& before, const auto& after) {
    if (before.empty() || !after.empty()) return;
    log::warning("{}: no samples while the video was recorded", sensor);
  };
  check("imu0", all.imu, sensors.imu);
  check("dvl0", all.dvl, sensors.dvl);
  check("pressure0", all.pressure, sensors.pressure);
  check("depth0", all.depth, sensors.depth);
}

void warn_of_mounting() {
  log::warning(
      "rig.yaml: the mounting of camera and sensors is ASSUMED: the camera looks forward, all are "
      "at one place; correct it there, or give --rig; `apvi doctor` checks it");
}

}  // namespace apvi::importer
