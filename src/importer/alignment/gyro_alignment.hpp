// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apvi/sensors/camera_model.hpp"
#include "apvi/sensors/samples.hpp"
#include "doctor/image_pairs.hpp"

namespace apvi::importer {

/// When a video begins on the clock of a gyro.
struct GyroAlignment {
  std::optional<Stamp> start = {};  ///< of the video's first image; nullopt: not found
  std::string why_not = {};         ///< why it was not found, as a part of a sentence
  double sigma_s = 0.0;             ///< of the start
  double correlation = 0.0;         ///< of the rates of camera and gyro, 0 to 1
  double elsewhere = 0.0;           ///< the largest correlation at another time
};

/// Finds when a video begins by its rotation, for any mounting of the camera. The rates of the
/// camera are searched for in the whole log (`match_rates`); epipolar lines then give the exact
/// time (`fit_camera_against_gyro`). `pairs` have stamps that count from the video's first image,
/// `camera` is that of the images and may be a rough guess. `near` limits the start to times from
/// which the clock of the camera is not far off; it counts where the whole log is ambiguous.
GyroAlignment align_by_gyro(const std::vector<doctor::ImagePair>& pairs, const CameraModel& camera,
                            const std::vector<ImuSample>& imu,
                            const std::optional<std::pair<Stamp, Stamp>>& near);

}  // namespace apvi::importer
