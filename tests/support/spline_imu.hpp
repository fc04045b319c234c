// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "apvi/geometry/so3.hpp"
#include "apvi/sensors/samples.hpp"
#include "core/random.hpp"
#include "geometry/spline.hpp"
#include "imu/propagation.hpp"

/// Noise-free IMU data along a smooth spline, as ground truth for integration tests.
namespace apvi::test {

inline Eigen::Vector3d random_vector(Random& random, double size) {
  return {random.uniform(-size, size), random.uniform(-size, size), random.uniform(-size, size)};
}

inline Eigen::Vector3d normal_vector(Random& random, double sigma) {
  return {random.normal(0.0, sigma), random.normal(0.0, sigma), random.normal(0.0, sigma)};
}

/// A vehicle moving at about 0.5 m/s with random yaw, roll and pitch, scaled by `motion_scale`.
inline Se3Spline wavy_spline(std::uint64_t seed, double duration_s, double motion_scale = 1.0) {
  Random random(seed);
  std::vector<SE3> control;
  SE3 pose;
  double yaw = 0.0;
  for (double t = 0.0; t < duration_s + 6.0; t += 1.0) {
    yaw += motion_scale * random.uniform(-0.35, 0.35);
    const Eigen::Quaterniond heading(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
    pose.translation +=
        heading * Eigen::Vector3d(0.5, 0.0, 0.0) + random_vector(random, motion_scale * 0.15);
    pose.rotation =
        heading * so3::exp(motion_scale * Eigen::Vector3d(random.uniform(-0.2, 0.2),
                                                          random.uniform(-0.2, 0.2), 0.0));
    control.push_back(pose);
  }
  return Se3Spline(Stamp{1'000'000'000}, Duration::from_seconds(1.0), std::move(control));
}

inline ImuSample imu_at(const Se3Spline& spline, const Eigen::Vector3d& gravity, Stamp stamp) {
  const Motion motion = spline.at(stamp);
  return {stamp, motion.angular_velocity_body,
          motion.T_world_body.rotation.conjugate() * (motion.acceleration_world - gravity)};
}

inline std::vector<ImuSample> imu_along(const Se3Spline& spline, const Eigen::Vector3d& gravity,
                                        double rate_hz) {
  std::vector<ImuSample> samples;
  const Duration period = Duration::from_seconds(1.0 / rate_hz);
  for (Stamp t = spline.start(); t <= spline.end(); t = t + period) {
    samples.push_back(imu_at(spline, gravity, t));
  }
  return samples;
}

inline imu::NavState nav_state_at(const Se3Spline& spline, Stamp stamp) {
  const Motion motion = spline.at(stamp);
  imu::NavState x;
  x.R_world_body = motion.T_world_body.rotation;
  x.p_world = motion.T_world_body.translation;
  x.v_body = motion.T_world_body.rotation.conjugate() * motion.velocity_world;
  return x;
}

}  // namespace apvi::test
