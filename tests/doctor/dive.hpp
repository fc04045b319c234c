// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <functional>
#include <string>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "doctor/doctor.hpp"
#include "geometry/spline.hpp"
#include "support/spline_imu.hpp"
#include "support/tmp_dir.hpp"

/// A simulated dive with all sensors, into which each test injects one fault.
namespace apvi::test {

inline const Eigen::Vector3d kTrueLever(0.2, -0.1, 0.3);

struct Dive {
  Se3Spline spline = wavy_spline(11, 120.0);
  std::vector<ImuSample> imu;
  std::vector<DvlSample> dvl;
  std::vector<PressureDepthSample> depth;
  std::vector<PressureSample> pressure;
  std::vector<StampedPose> reference;
  std::string rig =
      "body: imu0\nworld: up\nimu0: {rate_hz: 100}\n"
      "dvl0: {T_body_sensor: [1,0,0,0.2, 0,1,0,-0.1, 0,0,1,0.3, 0,0,0,1], velocity_noise: 0.005}\n";
  std::string pressure_unit = "Pa";

  /// Sample of a DVL with the given mounting at a time, with four beams and low noise.
  DvlSample ping(Stamp stamp, Random& random) const {
    const Motion motion = spline.at(stamp);
    const Eigen::Vector3d body = motion.T_world_body.rotation.conjugate() * motion.velocity_world +
                                 motion.angular_velocity_body.cross(kTrueLever);
    DvlSample sample;
    sample.stamp = stamp;
    sample.valid = true;
    sample.figure_of_merit = 0.01;
    sample.altitude = 5.0;
    sample.velocity = body + normal_vector(random, 0.003);
    const auto beams = default_dvl_beams();
    for (std::size_t i = 0; i < kDvlBeams; ++i) {
      sample.beams[i] =
          DvlBeam{beams[i].dot(sample.velocity) + random.normal(0.0, 0.003), 5.4, true};
    }
    return sample;
  }
  double depth_at(Stamp stamp) const {
    return 10.0 - spline.at(stamp).T_world_body.translation.z();
  }
};

/// A dive without faults: 100 Hz IMU, 5 Hz DVL, no pressure, depth, camera or reference.
inline Dive healthy_dive() {
  Dive dive;
  Random random(5);
  dive.imu = imu_along(dive.spline, {0.0, 0.0, -9.80665}, 100.0);
  for (ImuSample& s : dive.imu) {
    s.accel += normal_vector(random, 0.02);
    s.gyro += normal_vector(random, 0.001);
  }
  for (Stamp t = dive.spline.start(); t <= dive.spline.end(); t = t + Duration::from_seconds(0.2)) {
    dive.dvl.push_back(dive.ping(t, random));
  }
  return dive;
}

inline void add_depth(Dive& dive) {
  Random random(6);
  for (Stamp t = dive.spline.start(); t <= dive.spline.end(); t = t + Duration::from_seconds(0.1)) {
    dive.depth.push_back({t, dive.depth_at(t) + random.normal(0.0, 0.003)});
  }
  dive.rig += "depth0: {noise_m: 0.01}\n";
}

inline void add_pressure(Dive& dive) {
  Random random(7);
  for (Stamp t = dive.spline.start(); t <= dive.spline.end(); t = t + Duration::from_seconds(0.1)) {
    const double depth = dive.depth_at(t) + random.normal(0.0, 0.003);
    dive.pressure.push_back({t, 101325.0 + depth * 1025.0 * 9.80665});
  }
  dive.rig += "pressure0: {noise_m: 0.01}\n";
}

inline std::string imu_csv(const std::vector<ImuSample>& samples) {
  // With units, as the reader converts accelerations in g without one.
  std::string text =
      "#timestamp [ns],w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1],"
      "a_x [m s^-2],a_y [m s^-2],a_z [m s^-2]\n";
  for (const ImuSample& s : samples) {
    text += fmt::format("{},{},{},{},{},{},{}\n", s.stamp.ns, s.gyro.x(), s.gyro.y(), s.gyro.z(),
                        s.accel.x(), s.accel.y(), s.accel.z());
  }
  return text;
}

inline std::string dvl_csv(const std::vector<DvlSample>& samples) {
  std::string text =
      "#timestamp "
      "[ns],v_x,v_y,v_z,figure_of_merit,altitude,valid,beam0_v,beam1_v,beam2_v,beam3_v\n";
  for (const DvlSample& s : samples) {
    text += fmt::format("{},{},{},{},{},{},{:d}", s.stamp.ns, s.velocity.x(), s.velocity.y(),
                        s.velocity.z(), s.figure_of_merit.value_or(0.0), s.altitude.value_or(0.0),
                        s.valid);
    for (const auto& beam : s.beams) text += beam ? fmt::format(",{}", beam->velocity) : ",";
    text += "\n";
  }
  return text;
}

inline void write_dive(const TmpDir& dir, const Dive& dive) {
  if (!dive.rig.empty()) dir.write("rig.yaml", dive.rig);
  dir.write("mav0/imu0/data.csv", imu_csv(dive.imu));
  dir.write("mav0/dvl0/data.csv", dvl_csv(dive.dvl));
  if (!dive.depth.empty()) {
    std::string text = "#timestamp [ns],depth [m]\n";
    for (const PressureDepthSample& s : dive.depth)
      text += fmt::format("{},{}\n", s.stamp.ns, s.depth_m);
    dir.write("mav0/depth0/data.csv", text);
  }
  if (!dive.pressure.empty()) {
    std::string text = fmt::format("#timestamp [ns],pressure [{}]\n", dive.pressure_unit);
    for (const PressureSample& s : dive.pressure) {
      text += fmt::format("{},{}\n", s.stamp.ns, s.pressure_pa);
    }
    dir.write("mav0/pressure0/data.csv", text);
  }
  if (!dive.reference.empty()) {
    std::string text = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w,q_x,q_y,q_z\n";
    for (const StampedPose& p : dive.reference) {
      const auto& t = p.T_world_body.translation;
      const auto& q = p.T_world_body.rotation;
      text += fmt::format("{},{},{},{},{},{},{},{}\n", p.stamp.ns, t.x(), t.y(), t.z(), q.w(),
                          q.x(), q.y(), q.z());
    }
    dir.write("mav0/state_groundtruth_estimate0/data.csv", text);
  }
}

inline doctor::Report examine(const TmpDir& dir) {
  io::DatasetConfig config;
  config.path = dir.path().string();
  return doctor::examine(config);
}

inline doctor::Report examine(const Dive& dive) {
  const TmpDir dir;
  write_dive(dir, dive);
  return examine(dir);
}

/// A value of a finding; NaN when the finding or value is missing.
inline double value_of(const doctor::Report& report, const std::string& sensor,
                       const std::string& check, const std::string& name) {
  const doctor::Finding* finding = report.find(sensor, check);
  if (finding == nullptr) return std::nan("");
  for (const auto& [key, value] : finding->values) {
    if (key == name) return value;
  }
  return std::nan("");
}

}  // namespace apvi::test

/// Expects a finding with this severity whose message or advice contains the words.
#define EXPECT_FINDING(report, sensor, check, level, words)                                \
  do {                                                                                     \
    const ::apvi::doctor::Report& checked_report = (report);                               \
    const auto* finding = checked_report.find(sensor, check);                              \
    ASSERT_NE(finding, nullptr) << (sensor) << ": " << (check) << "\n"                     \
                                << ::apvi::doctor::to_text(checked_report);                \
    EXPECT_EQ(finding->severity, ::apvi::doctor::Severity::level) << finding->message;     \
    EXPECT_THAT(finding->message + " -> " + finding->advice, ::testing::HasSubstr(words)); \
  } while (false)
