// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "doctor/camera_gyro_problem.hpp"

namespace apvi::doctor {

/// A camera against the gyro.
struct CameraGyroFit {
  CameraGyroModel model;                              ///< with the rig's lens
  CameraGyroVector sigma = CameraGyroVector::Zero();  ///< of it, leaving out parts of the data
  CameraGyroModel lens_model;                         ///< with a free lens
  CameraGyroVector lens_sigma = CameraGyroVector::Zero();
  double rms_px = 0.0;           ///< robust, of the epipolar distances, with the rig's lens
  double lens_rms_px = 0.0;      ///< with a free lens
  double rms_with_rig_px = 0.0;  ///< with the rig's time offset and rotation
  double lens_gain = 0.0;        ///< of the free lens, in sigmas
  double uniqueness = 0.0;       ///< how much better than any other solution [sigmas]
  double time_uniqueness = 0.0;  ///< the same, against those with another time offset
  bool is_near_rig = false;      ///< its rotation is within 30 degrees of the rig's
  std::size_t pairs = 0;
};

/// Fits time offset, rotation and gyro scale, without a guess: from all permutations of axes and
/// time offsets within a second. Then with focal length and radial distortion as well. `rig` has
/// the rig's time offset and rotation. Empty with fewer than 20 pairs.
std::optional<CameraGyroFit> fit_camera_against_gyro(const CameraGyroProblem& problem,
                                                     const CameraGyroModel& rig);

}  // namespace apvi::doctor
