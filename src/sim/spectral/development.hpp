// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace apvi::sim {

/// What a camera chose for a frame.
struct Development {
  double gain = 1.0;                                        ///< full scale is 1 / gain
  Eigen::Vector3d white_balance = Eigen::Vector3d::Ones();  ///< red, green, blue; green 1
};

/// Means of the raw values of an image, RGB.
struct MeanLight {
  Eigen::Vector3d behind_lens = Eigen::Vector3d::Ones();  ///< what the exposure control sees
  Eigen::Vector3d clear = Eigen::Vector3d::Ones();  ///< of surfaces, without water and lens shading
};

}  // namespace apvi::sim
