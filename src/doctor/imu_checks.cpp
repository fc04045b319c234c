// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>

#include "doctor/checks.hpp"

namespace apvi::doctor {
namespace {

constexpr double kStandardGravity = 9.80665;
constexpr double kGravityOk = 0.03;  // of its size
constexpr double kGravityWarning = 0.25;
// A body under water turns slower than this most of the time [rad/s].
constexpr double kTurnsFast = 1.5;
constexpr double kAlongAxis = 0.8;

bool about(double value, double target) {
  return std::abs(value / target - 1.0) < 0.2;
}

void check_gravity_size(const ImuObservations& imu, Report& report) {
  const double norm = imu.accel_norm.median();
  const double off = std::abs(norm / kStandardGravity - 1.0);
  Finding f{Severity::ok, "imu0",
            "gravity",    fmt::format("median specific force {:.4g} m/s²", norm),
            "",           {{"median_m_s2", norm}}};
  if (about(norm, 1.0)) {
    f.severity = Severity::error;
    f.advice = "these are g: multiply the accelerations by 9.80665 (sensor_msgs/Imu wants m/s²)";
  } else if (about(norm, 1000.0) || about(norm, 980.665)) {
    f.severity = Severity::error;
    f.advice = "these are milli-g or cm/s²: convert the accelerations to m/s²";
  } else if (norm < 0.3 * kStandardGravity) {
    f.severity = Severity::error;
    f.advice = "gravity seems to be taken out: log the accelerometer's raw specific force";
  } else if (off > kGravityOk) {
    f.severity = off > kGravityWarning ? Severity::error : Severity::warning;
    f.advice = "an accelerometer at rest reads 9.8: check unit, range and calibration";
  }
  report.add(std::move(f));
}

// Where "up" lies in the body, against what the world frame of the rig leads to expect.
void check_gravity_direction(const Case& c, Report& report) {
  const Eigen::Vector3d up = c.seen.imu.accel_sum.normalized();
  if (!up.allFinite() || up.norm() < 0.5) return;
  Eigen::Index axis = 0;
  const double largest = up.cwiseAbs().maxCoeff(&axis);
  const double expected = c.rig.world == WorldFrame::ned ? -1.0 : 1.0;
  Finding f{Severity::ok, "imu0", "up",
            "",           "",     {{"up_x", up.x()}, {"up_y", up.y()}, {"up_z", up.z()}}};
  f.message = fmt::format("the mean specific force points to ({:.2f}, {:.2f}, {:.2f})", up.x(),
                          up.y(), up.z());
  const char* world = c.rig.world == WorldFrame::ned ? "ned" : "up";
  if (axis != 2 || largest < kAlongAxis) {
    f.severity = Severity::note;
    f.message += ": the IMU's z axis is not vertical";
    f.advice = "fine where it is mounted so: every T_body_sensor is then relative to its axes";
  } else if (up.z() * expected < 0.0) {
    f.severity = Severity::warning;
    f.message += fmt::format(": z {} in a rig with world: {}", up.z() > 0.0 ? "up" : "down", world);
    f.advice = c.rig.world == WorldFrame::ned
                   ? "upside down, or the body is z up (then world: up), or the accelerometer's "
                     "signs are reversed"
                   : "upside down, or the body is forward-right-down (then world: ned), or the "
                     "accelerometer's signs are reversed";
  } else {
    f.message += fmt::format(", as a rig with world: {} has it", world);
  }
  report.add(std::move(f));
}

void check_gyro_size(const ImuObservations& imu, Report& report) {
  const double rate = imu.gyro_norm.median();
  Finding f{Severity::ok, "imu0",
            "gyro unit",  fmt::format("median angular rate {:.3g} rad/s", rate),
            "",           {{"median_rad_s", rate}}};
  if (rate > kTurnsFast) {
    f.severity = Severity::error;
    f.message += fmt::format(", that is {:.2g} turns a minute", rate * 30.0 / 3.14159265);
    f.advice = "these look like deg/s: multiply the angular rates by 0.0174533";
  }
  report.add(std::move(f));
}

}  // namespace

void check_imu(const Case& c, Report& report) {
  if (c.seen.imu.timing.count == 0) return;
  check_gravity_size(c.seen.imu, report);
  if (c.has_rig) check_gravity_direction(c, report);
  check_gyro_size(c.seen.imu, report);
}

}  // namespace apvi::doctor
