// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "apvi/core/stamp.hpp"
#include "apvi/fusion/config.hpp"
#include "apvi/fusion/degeneracy.hpp"
#include "apvi/fusion/pose_estimate.hpp"

namespace apvi::fusion {

/// How the error of a dead-reckoned pose moves with the vehicle: next = A error.
Matrix6 error_motion(const SE3& before, const SE3& now);

/// How fast an odometry's error wanders, from how its covariance grows beyond what `error_motion`
/// does to it. A single difference of covariances drowns in rounding of the trajectory, so it is
/// smoothed; and where something is measured (tilt, height) the covariance stands still while the
/// error wanders all the same, so the heading speaks for all rotation and the horizontal for all
/// position: one gyro and one velocity sensor make both.
class Walk {
 public:
  /// `smoothing_s`: time constant; variances per second never fall below those of `least`.
  Walk(double smoothing_s, double least_rotation, double least_position)
      : smoothing_s_(smoothing_s),
        least_rotation_(least_rotation),
        least_position_(least_position) {}
  void add(const PoseEstimate& before, const PoseEstimate& now, double dt);
  /// Covariance of what is added in `dt` [s].
  Matrix6 noise(double dt) const;

 private:
  double smoothing_s_;
  double least_rotation_;  // [rad/sqrt(s)]
  double least_position_;  // [m/sqrt(s)]
  double rotation_ = 0.0;  // [rad²/s]
  double position_ = 0.0;  // [m²/s]
  int count_ = 0;
};

/// What measurements of tilt and height between two frames did to an error of covariance `grown`
/// that is `measured` after them: next = G error + noise of covariance N. Heading and horizontal
/// position follow as far as they are correlated.
struct Correction {
  Matrix6 G;
  Matrix6 N;
};
Correction tilt_and_height(const SE3& pose, const Matrix6& grown, const Matrix6& measured);

/// Fuses what DIPO and VIO say about motion, without counting twice what VIO got from DIPO.
///
/// The state is the error d of DIPO's pose and the error v of VIO's, as tangent vectors. Both
/// wander as an odometry's errors do; DIPO's shrinks too where it measures. Both belong to one true
/// pose, so every frame tells d - v; a Kalman filter with their correlation in its state finds
/// which of the two moved. When VIO starts or returns, v becomes a clone of d (Roumeliotis and
/// Burdick, "Stochastic cloning", ICRA 2002): where VIO begins says nothing, because it was told;
/// how it moves from there does.
class RelativeFilter {
 public:
  explicit RelativeFilter(const RelativeConfig& config);

  /// VIO's pose of a frame.
  struct Seen {
    PoseEstimate pose;                  ///< with the covariance that VIO claims
    std::optional<Matrix6> walk_per_s;  ///< how its error wanders; nothing: seen in the growth
                                        ///< of the covariance
    WellConditioned directions;         ///< that are used of it
  };
  /// One frame; stamps must not go back. Without `vio` DIPO goes on alone with the error known so
  /// far.
  void step(Stamp stamp, const PoseEstimate& dipo, const std::optional<Seen>& vio);

  /// DIPO's pose with its error taken off.
  PoseEstimate estimate() const;
  /// Of the newest frame; nothing when VIO was absent or began in it.
  std::optional<double> nis() const { return nis_; }
  /// Frames whose motion contradicted DIPO's beyond the gate.
  int rejected() const { return rejected_; }

 private:
  using Vector12 = Eigen::Matrix<double, 12, 1>;
  using Matrix12 = Eigen::Matrix<double, 12, 12>;

  void predict(double dt, const PoseEstimate& dipo, const std::optional<Seen>& vio);
  Matrix6 vio_noise(double dt, const Seen& vio);
  void clone(const Seen& vio);
  /// False when the gate refuses.
  bool update(const Seen& vio);

  RelativeConfig config_;
  Stamp stamp_;
  std::optional<PoseEstimate> dipo_;  // of the newest frame
  std::optional<PoseEstimate> vio_;   // the same; nothing when it was absent
  Vector12 mean_ = Vector12::Zero();  // [d, v]
  Matrix12 covariance_ = Matrix12::Zero();
  Walk dipo_walk_;
  Walk vio_walk_;
  std::optional<double> nis_;
  int rejected_ = 0;
};

}  // namespace apvi::fusion
