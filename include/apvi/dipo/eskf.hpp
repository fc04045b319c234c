// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "apvi/imu/propagation.hpp"

namespace apvi::dipo {

/// The vehicle's state and what the filter learns about its sensors.
struct State {
  imu::NavState nav;
  double dvl_time_offset_s = 0.0;  ///< by how much DVL stamps are late: true time = stamp - offset
  double dvl_scale_error = 0.0;    ///< reported velocity = (1 + error) times the true one
  Eigen::Quaterniond R_body_dvl = Eigen::Quaterniond::Identity();  ///< mounting
  Eigen::Vector3d p_body_dvl = Eigen::Vector3d::Zero();            ///< lever arm [m]
  double depth_bias_m = 0.0;                                       ///< reported depth - true depth
  Eigen::Vector3d p_last_ping = Eigen::Vector3d::Zero();  ///< clone of the position (paper's Eq. 3)
};

/// Order of the error state; the first fifteen are imu::NavIndex.
enum Index {
  kTimeOffset = imu::kNavSize,
  kScale = kTimeOffset + 1,
  kMounting = kScale + 1,
  kLeverArm = kMounting + 3,
  kDepthBias = kLeverArm + 3,
  kLastPing = kDepthBias + 1,
  kSize = kLastPing + 3
};
using Vector = Eigen::Matrix<double, kSize, 1>;
using Matrix = Eigen::Matrix<double, kSize, kSize>;

State boxplus(const State& state, const Vector& delta);

/// How fast the calibration may wander, per square root of a second. Zero holds a state still; a
/// state whose initial covariance is zero too is switched off.
struct CalibrationWalk {
  double time_offset = 0.0;  ///< [s/sqrt(s)]
  double scale = 0.0;        ///< [1/sqrt(s)]
  double mounting = 0.0;     ///< [rad/sqrt(s)]
  double lever_arm = 0.0;    ///< [m/sqrt(s)]
  double depth_bias = 0.0;   ///< [m/sqrt(s)]
};

/// A linearised measurement z = h(x) + noise: `residual` = z - h(x̂), `H` = dh/dδx, `R` the noise's
/// covariance. At most `kMaxRows` rows.
struct Measurement {
  static constexpr int kMaxRows = 4;
  using Residual = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxRows, 1>;
  using Jacobian = Eigen::Matrix<double, Eigen::Dynamic, kSize, Eigen::RowMajor, kMaxRows, kSize>;
  using Covariance = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxRows, kMaxRows>;

  explicit Measurement(int rows)
      : residual(Residual::Zero(rows)),
        H(Jacobian::Zero(rows, static_cast<int>(kSize))),
        R(Covariance::Zero(rows, rows)) {}
  int rows() const { return static_cast<int>(residual.size()); }

  Residual residual;
  Jacobian H;
  Covariance R;
};

/// Error-state Kalman filter: J. Sola, "Quaternion kinematics for the error-state Kalman filter",
/// 2017, chapters 5 and 6, with the state above. Copyable, so that history can be kept and
/// replayed.
class Eskf {
 public:
  Eskf() = default;
  Eskf(const State& state, const Matrix& covariance) : state_(state), P_(covariance) {}

  const State& state() const { return state_; }
  const Matrix& covariance() const { return P_; }

  /// One inertial step with the mean `gyro` and `accel` over `dt` [s].
  void propagate(const Eigen::Vector3d& gyro, const Eigen::Vector3d& accel, double dt,
                 const imu::World& world, const imu::Noise& noise, const CalibrationWalk& walk);

  /// What may have happened in a span without inertial data, one sigma.
  struct Unknown {
    double turn = 0.0;          ///< [rad]
    double speed_change = 0.0;  ///< [m/s]
  };
  /// Goes on straight ahead for `dt` [s] because nothing else is known.
  void coast(double dt, const Unknown& unknown);

  /// Normalised innovation squared of a measurement, before it is applied.
  double nis(const Measurement& measurement) const;
  /// Joseph-form update, reset of the error state included.
  void update(const Measurement& measurement);

  /// Adds `variance` to the diagonal from `index` on, `count` entries (after a gap, for instance).
  void inflate(int index, int count, double variance);
  /// Makes the last-ping clone equal to the position now (stochastic cloning: Roumeliotis and
  /// Burdick, "Stochastic cloning", ICRA 2002).
  void clone_position();

 private:
  State state_;
  Matrix P_ = Matrix::Zero();
};

}  // namespace apvi::dipo
