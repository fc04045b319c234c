// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>

#include "apvi/core/constants.hpp"
#include "doctor/checks.hpp"

namespace apvi::doctor {
namespace {

constexpr double kGravityOk = 0.03;  // relative to its magnitude
constexpr double kGravityWarning = 0.25;
// Underwater vehicles rotate slower than this most of the time [rad/s].
constexpr double kMaxMedianRate = 1.5;
constexpr double kAlongAxis = 0.8;

bool is_near(double value, double target) {
  return std::abs(value / target - 1.0) < 0.2;
}

void check_gravity_size(const ImuObservations& imu, Report& report) {
  const double norm = imu.accel_norm.median();
  const double off = std::abs(norm / kStandardGravity - 1.0);
  Finding f{Severity::ok, "imu0",
            "gravity",    fmt::format("median specific force {:.4g} m/s²", norm),
            "",           {{"median_m_s2", norm}}};
  if (is_near(norm, 1.0)) {
    f.severity = Severity::error;
    f.advice = "these are g: multiply the accelerations by 9.80665 (sensor_msgs/Imu requires m/s²)";
  } else if (is_near(norm, 1000.0) || is_near(norm, 980.665)) {
    f.severity = Severity::error;
    f.advice = "these are milli-g or cm/s²: convert the accelerations to m/s²";
  } else if (norm < 0.3 * kStandardGravity) {
    f.severity = Severity::error;
    f.advice = "gravity seems to be removed: log the accelerometer's raw specific force";
  } else if (off > kGravityOk) {
    f.severity = off > kGravityWarning ? Severity::error : Severity::warning;
    f.advice = "an accelerometer at rest reads 9.8: check unit, range and calibration";
  }
  report.add(std::move(f));
}

// Direction of "up" in the body frame, compared with the rig's world frame.
void check_gravity_direction(const CheckInput& c, Report& report) {
  const Eigen::Vector3d up = c.observed.imu.accel_sum.normalized();
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
    f.advice = "fine if mounted this way: every T_body_sensor is relative to its axes";
  } else if (up.z() * expected < 0.0) {
    f.severity = Severity::warning;
    f.message += fmt::format(": z points {}, but the rig has world: {}",
                             up.z() > 0.0 ? "up" : "down", world);
    f.advice = c.rig.world == WorldFrame::ned
                   ? "upside down, or the body is z up (then world: up), or the accelerometer's "
                     "signs are reversed"
                   : "upside down, or the body is forward-right-down (then world: ned), or the "
                     "accelerometer's signs are reversed";
  } else {
    f.message += fmt::format(", consistent with world: {}", world);
  }
  report.add(std::move(f));
}

void check_gyro_size(const ImuObservations& imu, Report& report) {
  const double rate = imu.gyro_norm.median();
  Finding f{Severity::ok, "imu0",
            "gyro unit",  fmt::format("median angular rate {:.3g} rad/s", rate),
            "",           {{"median_rad_s", rate}}};
  if (rate > kMaxMedianRate) {
    f.severity = Severity::error;
    f.message += fmt::format(", i.e. {:.2g} revolutions per minute", rate * 30.0 / 3.14159265);
    f.advice = "these look like deg/s: multiply the angular rates by 0.0174533";
  }
  report.add(std::move(f));
}

}  // namespace

void check_imu(const CheckInput& c, Report& report) {
  if (c.observed.imu.timing.count == 0) return;
  check_gravity_size(c.observed.imu, report);
  if (c.has_rig) check_gravity_direction(c, report);
  check_gyro_size(c.observed.imu, report);
}

}  // namespace apvi::doctor
