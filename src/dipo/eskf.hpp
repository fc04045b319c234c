// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "imu/propagation.hpp"

namespace apvi::dipo {

/// State of the vehicle and calibration parameters of its sensors.
struct State {
  imu::NavState nav;
  double dvl_time_offset_s = 0.0;  ///< true time = stamp - offset
  double dvl_scale_error = 0.0;    ///< reported velocity = (1 + error) * true velocity
  Eigen::Quaterniond R_body_dvl = Eigen::Quaterniond::Identity();  ///< mounting
  Eigen::Vector3d p_body_dvl = Eigen::Vector3d::Zero();            ///< lever arm [m]
  double depth_bias_m = 0.0;                                       ///< reported depth - true depth
  Eigen::Vector3d p_last_ping =
      Eigen::Vector3d::Zero();  ///< position clone at the last ping (paper's Eq. 3)
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

/// Random walk of the calibration parameters, per square root of a second. Zero keeps a parameter
/// constant; one whose initial covariance is also zero is disabled.
struct CalibrationRandomWalk {
  double time_offset = 0.0;  ///< [s/sqrt(s)]
  double scale = 0.0;        ///< [1/sqrt(s)]
  double mounting = 0.0;     ///< [rad/sqrt(s)]
  double lever_arm = 0.0;    ///< [m/sqrt(s)]
  double depth_bias = 0.0;   ///< [m/sqrt(s)]
};

/// A linearized measurement z = h(x) + noise: `residual` = z - h(x̂), `H` = dh/dδx, `R` the noise
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
/// 2017, chapters 5 and 6, for the state above. Copyable, so that past filters can be stored and
/// replayed.
class Eskf {
 public:
  Eskf() = default;
  Eskf(const State& state, const Matrix& covariance) : state_(state), P_(covariance) {}

  const State& state() const { return state_; }
  const Matrix& covariance() const { return P_; }

  /// Propagates by `dt` [s] with the mean `gyro` and `accel` over the step.
  void propagate(const Eigen::Vector3d& gyro, const Eigen::Vector3d& accel, double dt,
                 const imu::EarthModel& world, const imu::Noise& noise,
                 const CalibrationRandomWalk& walk);

  /// Uncertainty of the motion during a gap in the inertial data, one sigma.
  struct CoastUncertainty {
    double turn = 0.0;          ///< [rad]
    double speed_change = 0.0;  ///< [m/s]
  };
  /// Propagates at constant velocity for `dt` [s], for gaps in the inertial data.
  void coast(double dt, const CoastUncertainty& uncertainty);

  /// Normalized innovation squared of a measurement, without applying it.
  double nis(const Measurement& measurement) const;
  /// Joseph-form update, including the reset of the error state.
  void update(const Measurement& measurement);

  /// Adds `variance` to `count` diagonal entries starting at `index`, e.g. after a gap.
  void inflate(int index, int count, double variance);
  /// Sets the last-ping clone to the current position (stochastic cloning: Roumeliotis and Burdick,
  /// "Stochastic cloning", ICRA 2002).
  void clone_position();

 private:
  State state_;
  Matrix P_ = Matrix::Zero();
};

}  // namespace apvi::dipo
