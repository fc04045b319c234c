// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>

#include "apvi/dipo/config.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "dipo/eskf.hpp"

namespace apvi::dipo {

/// Estimates the initial attitude and velocity, at rest or in motion: the DVL gives the change of
/// velocity between two pings, so the remaining specific force is gravity.
class Initializer {
 public:
  /// What initialization is still waiting for.
  enum class Waiting { imu, dvl_lock, window };

  struct Start {
    ImuSample sample;  ///< the inertial sample whose time `state` refers to
    State state;
    Matrix covariance;
    bool has_depth = false;  ///< the z position is measured
  };

  /// Known biases are given when a run continues after a pause.
  Initializer(const Config& config, const Rig& rig,
              const Eigen::Vector3d& gyro_bias = Eigen::Vector3d::Zero(),
              const Eigen::Vector3d& accel_bias = Eigen::Vector3d::Zero())
      : config_(config), rig_(rig), gyro_bias_(gyro_bias), accel_bias_(accel_bias) {}

  void add(const ImuSample& sample);
  void add(const DvlSample& sample);
  /// Measured depth of the sensor at `p_body_sensor` below the surface [m]; the latest value is
  /// used.
  void add_pressure_depth(double depth_m, const Eigen::Vector3d& p_body_sensor);

  std::optional<Start> try_start() const;
  Waiting waiting() const;

 private:
  struct Depth {
    double depth_m;
    Eigen::Vector3d p_body_sensor;
  };

  Eigen::Vector3d body_velocity(const DvlSample& ping, const Eigen::Vector3d& gyro) const;
  State make_state(const Eigen::Vector3d& force_body, const Eigen::Vector3d& v_body) const;
  /// `force_by_bias`: d force_body / d (gyro bias, accelerometer bias).
  Matrix make_covariance(const State& state, const Eigen::Vector3d& force_body,
                         const Eigen::Matrix<double, 3, 6>& force_by_bias) const;

  Config config_;
  Rig rig_;
  Eigen::Vector3d gyro_bias_;
  Eigen::Vector3d accel_bias_;
  std::deque<ImuSample> imu_;  // without the known biases
  std::deque<DvlSample> pings_;
  std::optional<Depth> depth_;
};

}  // namespace apvi::dipo
