// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "apvi/sensors/camera_model.hpp"

/// Intrinsics of a camera that nobody calibrated, from what is known of its angle of view. Good
/// enough to try; a calibration under water is always better.
namespace apvi::importer {

inline constexpr double kWaterRefraction = 1.333;  ///< refractive index of water against air

/// How rays map to the image in air.
enum class Lens {
  rectilinear,  ///< r = f tan(angle)
  equidistant,  ///< r = f angle: action cameras in their wide modes
};

struct FieldOfView {
  double degrees = 70.0;
  bool diagonal = false;  ///< else horizontal
  Lens lens = Lens::rectilinear;
  bool in_air = false;      ///< else as seen where the images were taken
  bool stated = false;      ///< by the file or the user, and not a guess
  std::string origin = {};  ///< where the angle is from, for messages
};

/// Applied when nothing is known: 70 degrees, horizontal, as seen where the images were taken.
FieldOfView default_field_of_view();

/// What a GoPro's metadata say: `mode` is VFOV ("W", "L", "N", "S"), empty if unknown;
/// `diagonal_deg` is ZFOV. nullopt if `device` is no GoPro and the metadata are empty.
std::optional<FieldOfView> gopro_field_of_view(const std::string& device, const std::string& mode,
                                               std::optional<double> diagonal_deg);

struct ImageSize {
  int width = 0;
  int height = 0;
};

/// A camera of that field of view, with square pixels and its principal point in the middle. If the
/// angle is one in air and the camera is `under_water`, it is that behind a flat port: a ray at the
/// angle a in water meets the lens at asin(1.333 sin a). Throws InputError for an angle that the
/// lens cannot have.
CameraModel::Parameters assumed_camera(const FieldOfView& view, ImageSize size, bool under_water);

}  // namespace apvi::importer
