// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "apvi/sensors/camera_model.hpp"

namespace apvi {

struct LensSample {
  Eigen::Vector2d pixel;
  Eigen::Vector3d direction;  ///< in the camera frame, of any length
};

/// Intrinsics and coefficients of least squared pixel error, by Levenberg-Marquardt from `start`,
/// whose distortion is radtan or equidistant. Radtan is estimated without k3 and k6. The lens does
/// not fold within the samples if `start` does not. nullopt for a fit that went astray.
std::optional<CameraModel> fit_lens(const CameraModel::Parameters& start,
                                    const std::vector<LensSample>& samples);

}  // namespace apvi
