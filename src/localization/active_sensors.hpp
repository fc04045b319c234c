// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

#include "apvi/localization/options.hpp"
#include "apvi/sensors/rig.hpp"

namespace apvi::localization {

/// The sensors of a run: enabled in the options, described by the rig, and present in the source.
struct ActiveSensors {
  bool imu = true;
  bool dvl = false;             ///< never without an IMU
  bool dvl_scale = false;       ///< without an IMU: gives the scale of poses by images
  bool pressure_scale = false;  ///< without a DVL and an IMU: the same, of a sensor of depth too
  std::size_t cameras = 0;
};

/// What a source has, besides what the rig describes.
struct RecordedSensors {
  bool images = true;
  bool imu = true;
};

/// Throws InputError when there is neither a DVL with an IMU nor a camera.
ActiveSensors select_sensors(const Options& options, const Rig& rig,
                             const RecordedSensors& recorded);

}  // namespace apvi::localization
