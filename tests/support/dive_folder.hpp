// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <string>

#include "support/spline_imu.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::test {

struct DiveFolderOptions {
  double duration_s = 60.0;
  bool dvl_valid = true;
  bool broken_samples = false;  ///< NaN, text, stamps an hour ahead and behind
};

namespace internal {

inline std::string imu_line(const ImuSample& s) {
  return fmt::format("{},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g}\n", s.stamp.ns, s.gyro.x(),
                     s.gyro.y(), s.gyro.z(), s.accel.x(), s.accel.y(), s.accel.z());
}

inline std::string broken_imu_line(int k, std::int64_t ns) {
  constexpr std::int64_t kHour = 3'600'000'000'000;
  switch (k) {
    case 2000:
      return fmt::format("{},nan,0,0,0,0,9.8\n", ns + 1);
    case 2500:
      return fmt::format("{},0,0,zero,0,0,9.8\n", ns + 1);
    case 3000:
      return fmt::format("{},0,0,0,0,0,9.8\n", ns + kHour);
    case 3500:
      return fmt::format("{},0,0,0,0,0,9.8\n", ns - kHour);
    case 4000:
      return fmt::format("{},0,0,0,0,0,inf\n", ns + 1);
    default:
      return "";
  }
}

}  // namespace internal

/// Writes a data set folder with noisy IMU, DVL and depth data and ground truth along a smooth
/// dive. The DVL frame is the body frame.
inline void write_dive(const TmpDir& tmp, const std::string& name, const DiveFolderOptions& dive) {
  const Se3Spline spline = wavy_spline(51, dive.duration_s);
  const Eigen::Vector3d gravity(0.0, 0.0, -9.80665);
  Random random(52);
  std::string imu =
      "#timestamp [ns],w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1],"
      "a_x [m s^-2],a_y [m s^-2],a_z [m s^-2]\n";
  std::string dvl =
      "#timestamp [ns],v_x [m s^-1],v_y [m s^-1],v_z [m s^-1],"
      "figure_of_merit [m s^-1],altitude [m],valid [0|1]\n";
  std::string depth = "#timestamp [ns],depth [m]\n";
  std::string truth = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w,q_x,q_y,q_z\n";
  int k = 0;
  for (ImuSample sample : imu_along(spline, gravity, 100.0)) {
    const Motion motion = spline.at(sample.stamp);
    const std::int64_t ns = sample.stamp.ns;
    sample.gyro += normal_vector(random, 2e-3);
    sample.accel += normal_vector(random, 2e-2);
    imu += internal::imu_line(sample);
    if (dive.broken_samples) imu += internal::broken_imu_line(k, ns);
    if (k % 20 == 5) {
      const Eigen::Vector3d v = motion.T_world_body.rotation.conjugate() * motion.velocity_world +
                                normal_vector(random, 0.005);
      dvl += fmt::format("{},{:.9g},{:.9g},{:.9g},,,{}\n", ns, v.x(), v.y(), v.z(),
                         dive.dvl_valid ? 1 : 0);
    }
    const Eigen::Vector3d& p = motion.T_world_body.translation;
    if (k % 10 == 3) {
      depth += fmt::format("{},{:.9g}\n", ns, 10.0 - p.z() + random.normal(0.0, 0.01));
    }
    const Eigen::Quaterniond& q = motion.T_world_body.rotation;
    truth += fmt::format("{},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f}\n", ns, p.x(), p.y(),
                         p.z(), q.w(), q.x(), q.y(), q.z());
    ++k;
  }
  const std::string mav = name + "/mav0/";
  tmp.write(mav + "imu0/data.csv", imu);
  tmp.write(mav + "dvl0/data.csv", dvl);
  tmp.write(mav + "depth0/data.csv", depth);
  tmp.write(mav + "state_groundtruth_estimate0/data.csv", truth);
  tmp.write(name + "/rig.yaml",
            "imu0: {rate_hz: 100, gyro_noise_density: 2.0e-4, accel_noise_density: 2.0e-3}\n"
            "dvl0: {velocity_noise: 0.005}\n"
            "depth0: {noise_m: 0.01}\n");
}

}  // namespace apvi::test
