// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "apvi/sensors/camera_model.hpp"
#include "apvi/sensors/port.hpp"
#include "apvi/sensors/rig.hpp"

namespace apvi {

/// A central camera that stands for one behind a port.
struct CentralCamera {
  CameraModel model;
  /// Center of its rays, in the frame of the lens [m]. The axes are those of the lens.
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
};

/// How far pixels of the central model are from those of the port, over the image.
struct CentralError {
  double rms_px = 0.0;
  double max_px = 0.0;
};

/// The central camera nearest to one behind a port. Its center is the point nearest to all rays in
/// the water, by least squares; then its intrinsics and coefficients are those of least squared
/// pixel error, over the image, for points at `range_m` from the center. `distortion` is radtan
/// (the rational model without k3 and k6) or equidistant; absent: the one with the smaller error.
/// Throws InputError when neither describes the whole image.
CentralCamera fit_central_camera(const PortCamera& camera, double range_m,
                                 std::optional<Distortion> distortion = std::nullopt);

/// Error for points at `range_m` from the center.
CentralError central_error(const PortCamera& camera, const CentralCamera& central, double range_m);

/// One line for the log of a camera behind a port: its central model, and how far that is off.
/// Empty without a port.
std::string port_summary(const CameraCalibration& camera);

}  // namespace apvi
