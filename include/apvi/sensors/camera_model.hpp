// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

namespace apvi {

enum class Distortion { none, radtan, equidistant };

/// A pinhole camera with lens distortion. Pixel coordinates follow OpenCV: the center of the
/// top-left pixel is (0, 0). Camera frame: x right, y down, z forward.
///
/// radtan: k1, k2, p1, p2 (Brown-Conrady, as OpenCV's `calib3d`). equidistant: k1..k4 (Kannala and
/// Brandt 2006, as OpenCV's `fisheye`).
class CameraModel {
 public:
  struct Parameters {
    double fx = 0.0;
    double fy = 0.0;
    double cx = 0.0;
    double cy = 0.0;
    Distortion distortion = Distortion::none;
    std::array<double, 4> coefficients{};
    int width = 0;
    int height = 0;
  };
  using Jacobian23 = Eigen::Matrix<double, 2, 3>;

  CameraModel() = default;
  explicit CameraModel(const Parameters& parameters);

  const Parameters& parameters() const { return p_; }

  /// Pixel of a point in the camera frame [m]. nullopt behind the camera, or where the distortion
  /// polynomial is not monotonic and would map wide rays into the image. `jacobian`, if given,
  /// receives d pixel / d point. Pixels outside the image are returned too.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& p_camera,
                                         Jacobian23* jacobian = nullptr) const;
  /// Unit ray in the camera frame that projects to the pixel; nullopt where the distortion has no
  /// inverse.
  std::optional<Eigen::Vector3d> unproject(const Eigen::Vector2d& pixel) const;
  bool in_image(const Eigen::Vector2d& pixel, double border_px = 0.0) const;

 private:
  Parameters p_;
  double max_radius_ = 0.0;  // of the normalized image plane (radtan) or angle (equidistant)
};

}  // namespace apvi
