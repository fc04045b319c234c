// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "doctor/checks.hpp"
#include "doctor/depth_lag.hpp"
#include "doctor/dvl_imu_fit.hpp"
#include "doctor/dvl_reference_fit.hpp"
#include "doctor/gyro_fit.hpp"
#include "doctor/inertial_path.hpp"
#include "doctor/wording.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
constexpr double kTimeTolerance = 0.05;      // [s]
constexpr double kTimeDisagreement = 0.15;   // [s]
constexpr double kLeverArmTolerance = 0.15;  // [m]
constexpr double kRotationTolerance = 5.0 * kRadiansPerDegree;
constexpr double kRotationError = 45.0 * kRadiansPerDegree;
constexpr double kScaleTolerance = 0.04;
constexpr double kMinCorrelation = 0.5;

// A mounting in the rig's convention: signs of the reported components, then a rotation.
struct RigMounting {
  Matrix3d rotation = Matrix3d::Identity();
  Vector3d signs = Vector3d::Ones();
  double rotation_angle = 0.0;  // of the rotation relative to the rig's [rad]
  Vector3d axis = Vector3d::UnitZ();
};

RigMounting with_signs(const Matrix3d& mounting, const Vector3d& signs, const Matrix3d& given) {
  RigMounting m{mounting * signs.asDiagonal(), signs, 0.0, Vector3d::UnitZ()};
  const Eigen::AngleAxisd turn(Matrix3d(m.rotation * given.transpose()));
  m.rotation_angle = turn.angle();
  m.axis = turn.axis();
  return m;
}

// Chooses signs for which the rest is a rotation: the rig's own, otherwise one reversed axis, or
// all three if that is clearly closer to the rig.
RigMounting to_rig_mounting(const Matrix3d& mounting, const Rig& rig) {
  const Matrix3d given =
      rig.dvl ? rig.dvl->T_body_dvl.rotation.toRotationMatrix() : Matrix3d::Identity();
  const Vector3d own = rig.dvl ? rig.dvl->axis_signs : Vector3d::Ones();
  const double handed = mounting.determinant();
  if (handed * own.prod() > 0.0) return with_signs(mounting, own, given);
  if (handed > 0.0) return with_signs(mounting, Vector3d::Ones(), given);
  RigMounting best = with_signs(mounting, {1, 1, -1}, given);
  for (const Vector3d& signs : {Vector3d(1, -1, 1), Vector3d(-1, 1, 1)}) {
    const RigMounting candidate = with_signs(mounting, signs, given);
    if (candidate.rotation_angle < best.rotation_angle - 1e-3) best = candidate;
  }
  RigMounting all = with_signs(mounting, -Vector3d::Ones(), given);
  if (all.rotation_angle < kRotationError && all.rotation_angle < 0.5 * best.rotation_angle)
    return all;
  return best;
}

void report_time(const DvlImuFit& fit, const DvlMounting& rig, Report& report) {
  const double off = fit.time_offset_s - rig.time_offset_s;
  Finding f{Severity::ok,
            "dvl0",
            "time, imu",
            "",
            "",
            {{"time_offset_s", fit.time_offset_s},
             {"sigma_s", fit.time_offset_sigma_s},
             {"rms_m_s", fit.rms},
             {"rms_as_rig_m_s", fit.rms_with_rig}}};
  f.message = fmt::format(
      "relative to the IMU the stamps are {} (sigma {:.3f}); velocity changes agree to {:.4f} m/s, "
      "with the rig's calibration to {:.4f}",
      describe_offset(fit.time_offset_s), fit.time_offset_sigma_s, fit.rms, fit.rms_with_rig);
  if (std::abs(off) > std::max(kTimeTolerance, 3.0 * fit.time_offset_sigma_s)) {
    f.severity = Severity::warning;
    f.advice =
        fmt::format("set dvl0.time_offset_s: {:.2f} in the rig, or enable its online estimation",
                    fit.time_offset_s);
  }
  report.add(std::move(f));
}

void report_mounting(const DvlImuFit& fit, const CheckInput& c, Report& report) {
  const RigMounting m = to_rig_mounting(fit.mounting, c.rig);
  const Vector3d own = c.rig.dvl ? c.rig.dvl->axis_signs : Vector3d::Ones();
  const bool reversed = m.signs != own;
  const double sigma = fit.mounting_sigma.maxCoeff();
  Finding f{Severity::ok,
            "dvl0",
            "mounting",
            "",
            "",
            {{"turn_deg", m.rotation_angle / kRadiansPerDegree},
             {"sigma_deg", sigma / kRadiansPerDegree},
             {"reversed", reversed ? 1.0 : 0.0}}};
  f.message = fmt::format("rotated relative to the rig by {:.1f} deg about {} (sigma {:.1f} deg)",
                          m.rotation_angle / kRadiansPerDegree, list(m.axis, "{:.2f}"),
                          sigma / kRadiansPerDegree);
  if (reversed) {
    f.message =
        fmt::format("the axes are {}-handed, signs {}, and ",
                    fit.mounting.determinant() < 0.0 ? "left" : "right", list(m.signs, "{:.0f}")) +
        f.message;
  }
  if (!fit.mounting_is_observable) f.message += "; too little motion to check the axes' signs";
  if (reversed || (fit.mounting_is_observable && m.rotation_angle > kRotationError)) {
    f.severity = Severity::error;
  } else if (m.rotation_angle > std::max(kRotationTolerance, 4.0 * sigma)) {
    f.severity = Severity::warning;
  }
  if (f.severity != Severity::ok) {
    f.advice = fmt::format(
        "check the device's axes; the data fit a rotation of T_body_sensor of {} and "
        "axis_signs of {}",
        rotation_yaml(m.rotation), list(m.signs, "{:.0f}"));
    if ((fit.mounting + Matrix3d::Identity()).norm() < 0.5) {
      f.advice += "; all three reversed may also mean an accelerometer that reports gravity";
    }
  }
  report.add(std::move(f));
}

void report_lever_arm(const DvlImuFit& fit, const DvlMounting& rig, Report& report) {
  const Vector3d off = fit.lever_arm - rig.lever_arm;
  Finding f{Severity::ok,
            "dvl0",
            "lever arm",
            "",
            "",
            {{"x_m", fit.lever_arm.x()},
             {"y_m", fit.lever_arm.y()},
             {"z_m", fit.lever_arm.z()},
             {"sigma_m", fit.lever_arm_sigma.maxCoeff()}}};
  f.message = fmt::format("{} m from the IMU data, sigma {}; the rig says {}",
                          list(fit.lever_arm, "{:.2f}"), list(fit.lever_arm_sigma, "{:.2f}"),
                          list(rig.lever_arm, "{:.2f}"));
  const Vector3d limit = (4.0 * fit.lever_arm_sigma).cwiseMax(kLeverArmTolerance);
  if ((off.cwiseAbs().array() > limit.array()).any()) {
    f.severity = Severity::warning;
    f.advice =
        "measure it again, from the IMU to the DVL in the IMU's axes, or enable its online "
        "estimation";
  }
  report.add(std::move(f));
}

void report_scale(const DvlImuFit& fit, Report& report) {
  Finding f{Severity::ok,
            "dvl0",
            "scale, imu",
            fmt::format("true over reported velocity is between {:.3f} and {:.3f}", fit.scale_low,
                        fit.scale_high),
            "",
            {{"low", fit.scale_low}, {"high", fit.scale_high}}};
  if (fit.scale_low > 1.0 + kScaleTolerance || fit.scale_high < 1.0 - kScaleTolerance) {
    f.severity = Severity::warning;
    f.advice = "check units, dvl0.sound_speed in the rig and the accelerometer's scale";
  }
  report.add(std::move(f));
}

void report_reference(const DvlReferenceFit& fit, const std::optional<DvlImuFit>& imu,
                      const DvlMounting& rig, Report& report) {
  Finding f{Severity::ok,
            "dvl0",
            "time, reference",
            "",
            "",
            {{"time_offset_s", fit.time_offset_s},
             {"sigma_s", fit.time_offset_sigma_s},
             {"scale", fit.scale},
             {"yaw_deg", fit.yaw_rad / kRadiansPerDegree},
             {"rms_m", fit.rms},
             {"rms_as_rig_m", fit.rms_with_rig}}};
  f.message = fmt::format(
      "relative to the reference the stamps are {} (30-100 s baselines); sigma {:.2f}; dead "
      "reckoning over 60 s agrees to {:.2f} m, with the rig's offset to {:.2f}",
      describe_offset(fit.time_offset_s), fit.time_offset_sigma_s, fit.rms, fit.rms_with_rig);
  const double limit = std::max(kTimeTolerance, 3.0 * fit.time_offset_sigma_s);
  if (imu &&
      std::abs(fit.time_offset_s - imu->time_offset_s) > std::max(kTimeDisagreement, limit)) {
    f.severity = Severity::warning;
    f.advice = fmt::format(
        "relative to the IMU they are {}: the reference was made with other DVL timing; online "
        "estimation of the offset follows the IMU; to compare with this reference set "
        "dvl0.time_offset_s: {:.2f} in the rig",
        describe_offset(imu->time_offset_s), fit.time_offset_s);
  } else if (std::abs(fit.time_offset_s - rig.time_offset_s) > limit) {
    f.severity = Severity::warning;
    f.advice = fmt::format("set dvl0.time_offset_s: {:.2f} in the rig", fit.time_offset_s);
  }
  report.add(std::move(f));
  const bool imu_disagrees = imu && (imu->lever_arm - fit.lever_arm).head<2>().norm() > 0.5;
  if (fit.lever_arm_is_from_rig && !imu_disagrees) return;
  Finding arm{Severity::note,
              "dvl0",
              "lever, reference",
              "",
              "",
              {{"x_m", fit.lever_arm.x()}, {"y_m", fit.lever_arm.y()}}};
  arm.message =
      fmt::format("the reference is consistent with a DVL at {} m from its origin{}",
                  list(fit.lever_arm, "{:.2f}"),
                  fit.lever_arm_is_from_rig ? ", as in the rig" : ", not with the rig's lever arm");
  if (imu_disagrees) {
    arm.message += fmt::format(", the IMU data with {} m", list(imu->lever_arm, "{:.2f}"));
    arm.advice =
        "the reference's origin is not the IMU; keep the lever arm relative to the IMU; the "
        "estimated trajectory is then offset from the reference by the difference";
  }
  report.add(std::move(arm));
}

void report_depth(const DepthLag& lag, const std::string& sensor, const DvlMounting& rig,
                  Report& report) {
  Finding f{Severity::ok,
            "dvl0",
            "time, " + sensor,
            "",
            "",
            {{"time_offset_s", lag.time_offset_s},
             {"sigma_s", lag.time_offset_sigma_s},
             {"correlation", lag.correlation},
             {"depth_change_m", lag.depth_change}}};
  if (std::abs(lag.correlation) < kMinCorrelation) {
    f.severity = Severity::note;
    f.message = fmt::format("inconclusive: vertical velocity and {} have a correlation of {:.2f}",
                            sensor, lag.correlation);
    f.advice = "needs depth changes of about a meter; the changes here are " +
               fmt::format("{:.2f} m in 2 s", lag.depth_change);
    return report.add(std::move(f));
  }
  if (lag.correlation < 0.0) {
    report.add(
        {Severity::error,
         sensor,
         "sign",
         fmt::format("depth falls when the DVL goes down (correlation {:.2f})", lag.correlation),
         "depth is positive downward: flip its sign, or check the DVL's z axis or world in the rig",
         {{"correlation", lag.correlation}}});
  }
  f.message =
      fmt::format("relative to {} the stamps are {} (sigma {:.2f}; correlation {:.2f})", sensor,
                  describe_offset(lag.time_offset_s), lag.time_offset_sigma_s, lag.correlation);
  const double off = lag.time_offset_s - rig.time_offset_s;
  if (std::abs(off) > std::max(kTimeTolerance, 3.0 * lag.time_offset_sigma_s)) {
    f.severity = Severity::warning;
    f.advice = "set dvl0.time_offset_s in the rig if the depth sensor's stamps are correct";
  }
  report.add(std::move(f));
}

void check_depths(const CheckInput& c, const InertialPath& path, const DvlMounting& mounting,
                  Report& report) {
  const Observations& observed = c.observed;
  const auto check = [&](const DepthObservations& depth, const char* name, const Vector3d& p) {
    const auto lag = fit_dvl_against_depth(path, observed.dvl.buffer, mounting, depth.buffer, p);
    if (lag) report_depth(*lag, name, mounting, report);
  };
  check(observed.pressure, "pressure0",
        c.rig.pressure ? c.rig.pressure->p_body_sensor : Vector3d(Vector3d::Zero()));
  check(observed.depth, "depth0",
        c.rig.depth ? c.rig.depth->p_body_sensor : Vector3d(Vector3d::Zero()));
}

void report_imu_fit(const DvlImuFit& fit, const CheckInput& c, const DvlMounting& rig,
                    Report& report) {
  report_time(fit, rig, report);
  report_mounting(fit, c, report);
  report_lever_arm(fit, rig, report);
  report_scale(fit, report);
}

void check_dvl_motion(const CheckInput& c, const InertialPath& path, Report& report) {
  const DvlMounting rig = mounting_of(c.rig);
  const auto fit = fit_dvl_against_imu(path, c.observed.dvl.buffer, rig);
  DvlMounting best = rig;
  if (fit) {
    report_imu_fit(*fit, c, rig, report);
    // With clearly wrong axes in the rig, the other fits use the estimated mounting.
    const double scale = std::cbrt(std::abs(rig.matrix.determinant()));
    if ((scale * fit->mounting - rig.matrix).norm() > scale * 0.35)
      best.matrix = scale * fit->mounting;
  } else {
    report.add({Severity::note,
                "dvl0",
                "time, imu",
                "cannot be estimated from this recording: too short, or too little acceleration",
                "record at least a minute with starts, stops and turns",
                {}});
  }
  check_depths(c, path, best, report);
  if (!c.observed.reference) return;
  const auto reference =
      fit_dvl_against_reference(path, c.observed.dvl.buffer, best, *c.observed.reference);
  if (reference) report_reference(*reference, fit, rig, report);
}

}  // namespace

void check_motion(const CheckInput& c, Report& report) {
  if (c.observed.imu.buffer.size() < 2) return;
  check_gyro(c.observed.imu.buffer, report);
  const bool dvl_there = c.observed.dvl.buffer.size() > 1;
  if (!dvl_there) return;
  if (report.has_error("imu0")) {
    report.add({Severity::note,
                "dvl0",
                "time, imu",
                "not checked: resolve the IMU's errors first",
                "",
                {}});
    return;
  }
  check_dvl_motion(c, InertialPath(c.observed.imu.buffer), report);
}

}  // namespace apvi::doctor
