// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "apvi/core/stamp.hpp"
#include "apvi/fusion/config.hpp"
#include "fusion/degeneracy.hpp"
#include "fusion/pose_estimate.hpp"

namespace apvi::fusion {

/// Transition of the error of a dead-reckoned pose over a motion: next = A error.
Matrix6 error_transition(const SE3& before, const SE3& now);

/// Estimates the random walk of an odometry from the growth of its covariance beyond
/// `error_transition`. The growth is smoothed, as single differences are dominated by rounding.
/// Where the covariance is bounded by measurements (tilt, height) it does not show the process
/// noise, so the heading stands for all rotation and the horizontal for all position: one gyro and
/// one velocity sensor cause both.
class RandomWalkEstimator {
 public:
  /// `smoothing_s`: time constant; the sigmas are lower bounds.
  RandomWalkEstimator(double smoothing_s, double min_rotation_sigma, double min_position_sigma)
      : smoothing_s_(smoothing_s),
        min_rotation_(min_rotation_sigma),
        min_position_(min_position_sigma) {}
  void add(const PoseEstimate& before, const PoseEstimate& now, double dt);
  /// Process noise covariance over `dt` [s].
  Matrix6 noise(double dt) const;

 private:
  double smoothing_s_;
  double min_rotation_;    // [rad/sqrt(s)]
  double min_position_;    // [m/sqrt(s)]
  double rotation_ = 0.0;  // [rad²/s]
  double position_ = 0.0;  // [m²/s]
  int count_ = 0;
};

/// Effect of tilt and height measurements between two frames on the error, given its `predicted`
/// and its posterior (`measured`) covariance: next = G error + noise of covariance N. Heading and
/// horizontal position are corrected through their correlation.
struct TiltHeightCorrection {
  Matrix6 G;
  Matrix6 N;
};
TiltHeightCorrection tilt_height_correction(const SE3& pose, const Matrix6& predicted,
                                            const Matrix6& measured);

/// Fuses the motions of DIPO and VIO without double counting the information that VIO took from
/// DIPO.
///
/// The state consists of the error d of the DIPO pose and the error v of the VIO pose, as tangent
/// vectors. Both drift like odometry errors; measurements of tilt and height also reduce d. Both
/// poses describe one true pose, so every frame observes d - v; a Kalman filter that tracks their
/// correlation determines which of the two has drifted. When VIO starts or returns, v becomes a
/// clone of d (Roumeliotis and Burdick, "Stochastic cloning", ICRA 2002): the initial pose of VIO
/// carries no information, as it comes from DIPO; its subsequent motion does.
class RelativeFilter {
 public:
  explicit RelativeFilter(const RelativeConfig& config);

  /// Pose of VIO at a frame.
  struct VioPose {
    PoseEstimate pose;                         ///< with the covariance reported by VIO
    std::optional<Matrix6> random_walk_per_s;  ///< nullopt: from the covariance growth
    WellConditioned directions;                ///< directions of the pose to use
  };
  /// Processes one frame; stamps must not decrease. Without `vio`, DIPO continues with its last
  /// error estimate.
  void step(Stamp stamp, const PoseEstimate& dipo, const std::optional<VioPose>& vio);

  /// The DIPO pose corrected by its estimated error.
  PoseEstimate estimate() const;
  /// NIS of the newest frame; nullopt if VIO was absent or started in it.
  std::optional<double> nis() const { return nis_; }

 private:
  using Vector12 = Eigen::Matrix<double, 12, 1>;
  using Matrix12 = Eigen::Matrix<double, 12, 12>;

  void predict(double dt, const PoseEstimate& dipo, const std::optional<VioPose>& vio);
  Matrix6 vio_noise(double dt, const VioPose& vio);
  void clone(const VioPose& vio);
  /// Changes only the NIS if the gate rejects.
  void update(const VioPose& vio);

  RelativeConfig config_;
  Stamp stamp_;
  std::optional<PoseEstimate> dipo_;  // of the newest frame
  std::optional<PoseEstimate> vio_;   // of the newest frame; nullopt if absent
  Vector12 mean_ = Vector12::Zero();  // [d, v]
  Matrix12 covariance_ = Matrix12::Zero();
  RandomWalkEstimator dipo_walk_;
  RandomWalkEstimator vio_walk_;
  std::optional<double> nis_;
};

}  // namespace apvi::fusion
