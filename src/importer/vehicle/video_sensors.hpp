// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "importer/alignment/gyro_alignment.hpp"
#include "importer/import.hpp"
#include "importer/vehicle/sensor_data.hpp"

/// Sensors of another device than the one that recorded a video.
namespace apvi::importer {

/// The time of a video's first image on the sensors' clock: `options.video_start`, else what
/// `by_gyro` finds if the sensors have an IMU, else the time `created` of the file `video` if the
/// sensors were recorded then, else their beginning, with a warning. Throws InputError when
/// `options.video_start_by_gyro` and `by_gyro` finds nothing.
Stamp video_start(const std::filesystem::path& video, std::optional<Stamp> created,
                  const SensorData& sensors, const ImportOptions& options,
                  const std::function<GyroAlignment()>& by_gyro);

/// Keeps the samples from some seconds before the first image to some seconds after the last one.
/// Throws InputError when there are none; a warning names sensors without any.
void restrict_to_images(SensorData& sensors, Stamp first, Stamp last);

/// Warns that the mounting of the sensors, and of the camera, is assumed.
void warn_of_mounting();

}  // namespace apvi::importer
