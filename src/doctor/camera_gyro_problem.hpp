// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <vector>

#include "apvi/sensors/camera_model.hpp"
#include "doctor/image_pairs.hpp"
#include "doctor/inertial_path.hpp"

namespace apvi::doctor {

/// What relates the rotation seen by a camera to that of the gyro. A body rotation vector θ over
/// the time τ between two images is seen as R_camera_body (gyro_scale θ - gyro_bias τ).
struct CameraGyroModel {
  double time_offset_s = 0.0;  ///< true time = stamp of the image - offset
  Eigen::Quaterniond R_camera_body = Eigen::Quaterniond::Identity();
  double gyro_scale = 1.0;  ///< true over reported angular rate; negative: left-handed axes
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();  ///< beyond that of the path [rad/s]
  double focal = 1.0;                                   ///< true focal lengths over the rig's
  double radial = 0.0;  ///< added to the rig's first distortion coefficient
};

/// Order of the unknowns: time offset, rotation in the axes of the camera, gyro scale, gyro bias,
/// logarithm of the focal length, radial distortion.
inline constexpr int kTimeOffset = 0;
inline constexpr int kTurn = 1;
inline constexpr int kGyroScale = 4;
inline constexpr int kGyroBias = 5;
inline constexpr int kFocal = 8;
inline constexpr int kRadial = 9;
inline constexpr int kCameraGyroSize = 10;
using CameraGyroVector = Eigen::Matrix<double, kCameraGyroSize, 1>;
using CameraGyroMatrix = Eigen::Matrix<double, kCameraGyroSize, kCameraGyroSize>;

CameraGyroModel moved(const CameraGyroModel& model, const CameraGyroVector& step);
/// The rig's camera with the lens of the model.
CameraModel with_lens(const CameraModel& camera, double focal, double radial);

/// Normal equations of one block of pairs, in units of the noise.
struct CameraGyroNormal {
  CameraGyroMatrix H = CameraGyroMatrix::Zero();
  CameraGyroVector b = CameraGyroVector::Zero();
};

/// Epipolar distances of corners in pairs of images, for rotations that the gyro predicts. The
/// direction of translation of every pair is eliminated, so neither depth nor velocity is needed,
/// and a flat scene is no special case (Kneip and Lynen, "Direct optimization of frame-to-frame
/// rotation", ICCV 2013).
class CameraGyroProblem {
 public:
  CameraGyroProblem(const InertialPath& path, std::vector<ImagePair> pairs,
                    const CameraModel& camera);

  /// Normal equations of each of `blocks` blocks of pairs, consecutive in time, with robust
  /// weights. Rows and columns of the lens (focal, radial) are zero unless `lens`.
  std::vector<CameraGyroNormal> linearize(const CameraGyroModel& model, double noise_px, bool lens,
                                          std::size_t blocks) const;
  /// Mean robust cost of the corners of each pair, in units of the noise; empty where the IMU has a
  /// gap.
  std::vector<std::optional<double>> costs(const CameraGyroModel& model, double noise_px) const;
  /// Epipolar distances of all corners, without sign [px].
  std::vector<double> distances(const CameraGyroModel& model, double noise_px) const;
  /// Direction in which the camera moved, in the camera's axes at the first image, with the sign
  /// that places most corners in front; empty where undecided.
  std::optional<Eigen::Vector3d> direction(const CameraGyroModel& model, double noise_px,
                                           std::size_t pair) const;

  const std::vector<ImagePair>& pairs() const { return pairs_; }
  const CameraModel& camera() const { return camera_; }
  const InertialPath& path() const { return *path_; }

 private:
  // Unit rays of the corners of a pair, by column; NaN outside the lens model.
  struct Rays {
    Eigen::Matrix3Xd before;
    Eigen::Matrix3Xd now;
  };
  // A pair at a model: rays, rotation and direction of translation.
  struct Seen {
    Rays rays;  // `now` is turned into the axes of the first image
    Eigen::Vector3d turn;
    Eigen::Vector3d direction;
    double focal_px = 0.0;
  };

  Rays rays_of(const ImagePair& pair, double focal, double radial) const;
  std::optional<Eigen::Vector3d> body_turn(const ImagePair& pair, double offset) const;
  std::optional<Seen> see(const CameraGyroModel& model, double noise_px, std::size_t pair) const;
  void add_lens_columns(const CameraGyroModel& model, std::size_t pair, const Seen& seen,
                        Eigen::Matrix<double, kCameraGyroSize, Eigen::Dynamic>& columns) const;
  std::optional<CameraGyroNormal> normal_of(const CameraGyroModel& model, double noise_px,
                                            bool lens, std::size_t pair) const;

  const InertialPath* path_;
  std::vector<ImagePair> pairs_;
  CameraModel camera_;
  std::vector<Rays> rig_rays_;  // with the rig's lens
};

}  // namespace apvi::doctor
