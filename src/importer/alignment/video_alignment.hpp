// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "importer/alignment/gyro_alignment.hpp"
#include "importer/assumed_camera.hpp"
#include "importer/import.hpp"

namespace apvi::importer {

/// How far the clock of a camera is trusted, which nobody may have set [s].
inline constexpr double kCameraClockError_s = 600.0;

/// When a video begins on the clock of a gyro, by the rotation of its images (`align_by_gyro`). The
/// images are those that `options` select, at most ten minutes of them. The camera is that of
/// `options.rig`, else of an assumed lens, with the field of view `known`. `created` is the time at
/// which the file was created, by the clock of the camera. Throws InputError when the video cannot
/// be read.
GyroAlignment align_video(const std::filesystem::path& video, const ImportOptions& options,
                          const std::optional<FieldOfView>& known, std::optional<Stamp> created,
                          const std::vector<ImuSample>& imu);

}  // namespace apvi::importer
