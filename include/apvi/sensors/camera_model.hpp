// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <optional>

namespace apvi {

enum class Distortion { none, radtan, equidistant, double_sphere, eucm };

/// A central camera: all rays meet in one point. Pixel coordinates follow OpenCV: the center of the
/// top-left pixel is (0, 0). Camera frame: x right, y down, z forward.
///
/// Coefficients, in this order:
/// - radtan: k1, k2, p1, p2, k3, k4, k5, k6 (Brown-Conrady, and the rational model of OpenCV's
///   `calib3d`)
/// - equidistant: k1, k2, k3, k4 (Kannala and Brandt 2006; OpenCV's `fisheye`)
/// - double_sphere: xi, alpha (Usenko, Demmel and Cremers 2018)
/// - eucm: alpha, beta (Khomutenko, Garcia and Martinet 2016)
///
/// Coefficients that a lens does not use are zero.
class CameraModel {
 public:
  static constexpr std::size_t kMaxCoefficients = 8;
  using Coefficients = std::array<double, kMaxCoefficients>;

  struct Parameters {
    double fx = 0.0;  ///< focal lengths [px]
    double fy = 0.0;
    double cx = 0.0;  ///< principal point [px]
    double cy = 0.0;
    Distortion distortion = Distortion::none;
    Coefficients coefficients{};
    int width = 0;  ///< of the image [px]
    int height = 0;
  };
  using Jacobian23 = Eigen::Matrix<double, 2, 3>;

  CameraModel() = default;
  /// Requires positive focal lengths and coefficients that `lens_problem` accepts.
  explicit CameraModel(const Parameters& parameters);

  const Parameters& parameters() const { return p_; }

  /// Pixel of a point in the camera frame [m]. nullopt where the lens does not see: behind the
  /// camera (none, radtan), beyond the model's domain (double_sphere, eucm; both see behind), or
  /// where the distortion polynomial is not monotonic and would map wide rays into the image.
  /// `jacobian`, if given, receives d pixel / d point. Pixels outside the image are returned too.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& p_camera,
                                         Jacobian23* jacobian = nullptr) const;
  /// Unit ray in the camera frame that projects to the pixel; nullopt where the distortion has no
  /// inverse.
  std::optional<Eigen::Vector3d> unproject(const Eigen::Vector2d& pixel) const;
  /// Whether the pixel is in the image, at least `border_px` from its edges.
  bool in_image(const Eigen::Vector2d& pixel, double border_px = 0.0) const;

 private:
  Parameters p_;
  /// Where the lens ends: radius on the plane z = 1 (radtan), angle [rad] (equidistant).
  double max_radius_ = 0.0;
};

}  // namespace apvi
