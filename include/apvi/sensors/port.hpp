// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "apvi/sensors/camera_model.hpp"

namespace apvi {

enum class PortKind { flat, dome };

/// The window between camera and water, in the frame of the lens: its origin is the lens center,
/// its axes are those of the camera.
struct Port {
  PortKind kind = PortKind::flat;
  double glass_thickness_m = 0.005;
  double air_index = 1.0;
  double glass_index = 1.49;  ///< acrylic
  double water_index = 1.333;
  /// Flat: unit normal, toward the water, and distance of the lens center from the glass.
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double distance_m = 0.02;
  /// Dome: its inner radius, and the center of its spheres.
  double radius_m = 0.05;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
};

/// The ray of a pixel in the water.
struct WaterRay {
  Eigen::Vector3d origin;     ///< on the wet side of the port, in the frame of the lens [m]
  Eigen::Vector3d direction;  ///< unit

  /// The point at this distance from `center`, on the side that the ray points to [m].
  Eigen::Vector3d at(double distance, const Eigen::Vector3d& center) const;
};

/// A camera behind a port: rays bend where air meets glass and glass meets water (Snell), and do
/// not meet in one point. Agrawal, Ramalingam, Taguchi and Chari 2012; Jordt-Sedlazeck and
/// Koch 2013.
class PortCamera {
 public:
  /// `lens` is the camera in air. Throws InputError when the lens center is not in the air behind
  /// the port, or the water's index is below that of air.
  PortCamera(const CameraModel& lens, const Port& port);

  const CameraModel& lens() const { return lens_; }
  const Port& port() const { return port_; }

  /// The ray in the water that reaches the pixel; nullopt where the lens has none, or none that
  /// passes the port.
  std::optional<WaterRay> ray(const Eigen::Vector2d& pixel) const;
  /// Pixel of a point in the water, in the frame of the lens [m]: exact, by root finding in the
  /// plane of axis and point. nullopt for points that are not in front of the port or that the lens
  /// does not see.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point) const;

 private:
  CameraModel lens_;
  Port port_;
};

}  // namespace apvi
