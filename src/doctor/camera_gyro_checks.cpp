// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "doctor/camera_gyro_fit.hpp"
#include "doctor/camera_view.hpp"
#include "doctor/checks.hpp"
#include "doctor/dvl_imu_fit.hpp"
#include "doctor/wording.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kTimeTolerance = 0.01;  // [s]
constexpr double kMaxTimeSigma = 0.01;   // beyond: not observable [s]
constexpr double kTurnTolerance = 2.0 * kRadiansPerDegree;
constexpr double kMaxTurnSigma = 2.0 * kRadiansPerDegree;
constexpr double kTurnError = 20.0 * kRadiansPerDegree;
constexpr double kScaleTolerance = 0.05;
constexpr double kScaleError = 0.25;
constexpr double kFocalTolerance = 0.03;
constexpr double kMaxFocalSigma = 0.01;
constexpr double kDistortionTolerance_px = 4.0;  // at the corner that is most off
constexpr double kMinSigmas = 4.0;               // a difference below is no finding
constexpr double kMinUniqueness = 3.0;

// One camera with its fit.
struct Checked {
  std::string name;
  const CameraCalibration* camera = nullptr;
  CameraGyroFit fit;
  CameraGyroModel rig;
  bool lens_is_wrong = false;

  const CameraGyroModel& model() const { return lens_is_wrong ? fit.lens_model : fit.model; }
  const CameraGyroVector& sigma() const { return lens_is_wrong ? fit.lens_sigma : fit.sigma; }
  Vector3d turn() const { return so3::log(model().R_camera_body * rig.R_camera_body.conjugate()); }
  double turn_sigma() const { return sigma().segment<3>(kTurn).maxCoeff(); }
};

bool differs(double difference, double sigma, double tolerance) {
  return std::abs(difference) > std::max(tolerance, kMinSigmas * sigma);
}

void not_observable(const std::string& sensor, const std::string& check, const std::string& why,
                    const std::string& advice, Report& report) {
  report.add({Severity::note, sensor, check, "not observable: " + why, advice, {}});
}

std::string pose_yaml(const Quaterniond& R_body_camera, const Vector3d& p) {
  const Matrix3d R = R_body_camera.toRotationMatrix();
  std::string text;
  for (Eigen::Index i = 0; i < 3; ++i) {
    text += fmt::format("{:.5f},{:.5f},{:.5f},{:.4g}, ", R(i, 0) + 0.0, R(i, 1) + 0.0,
                        R(i, 2) + 0.0, p(i) + 0.0);
  }
  return "[" + text + "0,0,0,1]";
}

void report_time(const Checked& c, Report& report) {
  const double offset = c.model().time_offset_s;
  const double sigma = c.sigma()(kTimeOffset);
  if (sigma > kMaxTimeSigma) {
    return not_observable(c.name, "time, gyro",
                          fmt::format("the time offset has a sigma of {:.3f} s", sigma),
                          "record turns that start and stop", report);
  }
  if (!differs(offset - c.rig.time_offset_s, sigma, kTimeTolerance)) return;
  report.add({Severity::warning,
              c.name,
              "time, gyro",
              fmt::format("relative to the gyro the images are {} (sigma {:.4f}); the rig says "
                          "{:.3f} s",
                          describe_offset(offset, 3), sigma, c.rig.time_offset_s),
              fmt::format("set {}.time_offset_s: {:.3f} in the rig", c.name, offset),
              {{"time_offset_s", offset}, {"sigma_s", sigma}}});
}

std::string describe_turn(const Checked& c, const Vector3d& turn) {
  const double angle = turn.norm();
  return fmt::format(
      "turned relative to the rig by {:.1f} deg about {} of the camera (sigma {:.1f} "
      "deg)",
      angle / kRadiansPerDegree, list(turn / std::max(angle, 1e-9), "{:.2f}"),
      c.turn_sigma() / kRadiansPerDegree);
}

// Rotations alone cannot tell mirrored images from a camera that looks the other way: a mirrored
// view of a rotation is the rotation about the mirrored axis, reversed.
void report_mirrored(const Checked& c, const Mirror& mirror, Report& report) {
  const Quaterniond R_body_camera = mirror.R_camera_body.conjugate();
  const Vector3d left = so3::log(mirror.R_camera_body * c.rig.R_camera_body.conjugate());
  Finding f{Severity::error,
            c.name,
            "mirrored",
            fmt::format("the images are mirrored {}: they turn as those of a camera that looks the "
                        "other way",
                        mirror.name),
            fmt::format("flip the images {}", mirror.name),
            {{"pairs", static_cast<double>(mirror.pairs)}}};
  if (mirror.pairs > 0) {
    f.message += fmt::format(", but move as the DVL says ({} pairs of images)", mirror.pairs);
  } else {
    f.message += "; or it does look the other way";
    f.advice += fmt::format(
        ", or set {}.T_body_sensor: {}", c.name,
        pose_yaml(c.model().R_camera_body.conjugate(), c.camera->T_body_camera.translation));
  }
  if (differs(left.norm(), c.turn_sigma(), kTurnTolerance)) {
    f.advice += fmt::format(", and set {}.T_body_sensor: {}", c.name,
                            pose_yaml(R_body_camera, c.camera->T_body_camera.translation));
  }
  report.add(std::move(f));
}

void report_turn(const Checked& c, const CheckInput& input, const CameraGyroProblem& problem,
                 Report& report) {
  const Vector3d turn = c.turn();
  if (c.turn_sigma() > kMaxTurnSigma) {
    Eigen::Index axis = 0;
    c.sigma().segment<3>(kTurn).maxCoeff(&axis);
    return not_observable(
        c.name, "mounting",
        fmt::format("the camera's rotation about its {} axis has a sigma of {:.1f} deg",
                    "xyz"[axis], c.turn_sigma() / kRadiansPerDegree),
        "record turns about two axes, such as yaw and pitch", report);
  }
  const std::vector<DvlPing> none;
  const bool use_dvl = !report.has_error("dvl0");
  const auto mirror = find_mirror(use_dvl ? input.observed.dvl.buffer : none,
                                  mounting_of(input.rig), problem, c.model(), c.rig, c.fit.rms_px);
  if (mirror) return report_mirrored(c, *mirror, report);
  if (!differs(turn.norm(), c.turn_sigma(), kTurnTolerance)) return;
  report.add({turn.norm() > kTurnError ? Severity::error : Severity::warning,
              c.name,
              "mounting",
              describe_turn(c, turn),
              fmt::format("set {}.T_body_sensor: {} in the rig; or the images are rotated", c.name,
                          pose_yaml(c.model().R_camera_body.conjugate(),
                                    c.camera->T_body_camera.translation)),
              {{"turn_deg", turn.norm() / kRadiansPerDegree},
               {"sigma_deg", c.turn_sigma() / kRadiansPerDegree}}});
}

void report_gyro_scale(const Checked& c, Report& report) {
  const double scale = c.model().gyro_scale;
  const double sigma = c.sigma()(kGyroScale);
  if (scale < 0.0) {
    report.add({Severity::error,
                "imu0",
                "gyro axes, " + c.name,
                "the images fit the gyro only with one or three of its axes reversed",
                "check the signs of the gyro's axes: they must be right-handed",
                {{"scale", scale}}});
    return;
  }
  // A rotation that the data leave open leaves room for the scale as well.
  const bool is_open = c.turn_sigma() > kMaxTurnSigma;
  if (is_open && std::abs(scale - 1.0) < kScaleError) return;
  // With a free lens as well: it may explain the same.
  const bool with_any_lens =
      differs(c.fit.lens_model.gyro_scale - 1.0, c.fit.lens_sigma(kGyroScale), kScaleTolerance);
  if (!with_any_lens || !differs(scale - 1.0, sigma, kScaleTolerance)) return;
  const bool lens_is_open = c.fit.lens_sigma(kFocal) > kMaxFocalSigma;
  report.add({std::abs(scale - 1.0) > kScaleError ? Severity::error : Severity::warning,
              "imu0",
              "gyro scale, " + c.name,
              fmt::format(
                  "true over reported angular rate is {:.3f} by the images (sigma {:.3f}){}", scale,
                  sigma, lens_is_open ? ", unless the focal length is wrong by as much" : ""),
              fmt::format(
                  "multiply the angular rates by {:.3f}; its cause may be a wrong unit, or another "
                  "full-scale range than the driver assumes (factors of 2)",
                  scale),
              {{"scale", scale}, {"sigma", sigma}}});
}

void report_focal(const Checked& c, Report& report) {
  const CameraGyroModel& m = c.fit.lens_model;
  const CameraModel::Parameters p = with_lens(c.camera->model, m.focal, m.radial).parameters();
  if (!differs(m.focal - 1.0, c.fit.lens_sigma(kFocal), kFocalTolerance)) return;
  Finding f{
      Severity::warning,
      c.name,
      "focal length",
      fmt::format("{:.1f} % {} than in the rig (sigma {:.1f} %)", 100.0 * std::abs(m.focal - 1.0),
                  m.focal > 1.0 ? "longer" : "shorter", 100.0 * c.fit.lens_sigma(kFocal)),
      fmt::format("calibrate the camera in water; the rotations fit {}.intrinsics: [{:.1f}, "
                  "{:.1f}, {:.1f}, {:.1f}] with {:.3f} as the first distortion coefficient",
                  c.name, p.fx, p.fy, p.cx, p.cy, p.coefficients[0]),
      {{"focal_ratio", m.focal}, {"sigma", c.fit.lens_sigma(kFocal)}, {"fx_px", p.fx}}};
  report.add(std::move(f));
}

void report_distortion(const Checked& c, Report& report) {
  const CameraGyroModel& m = c.fit.lens_model;
  const double shift = lens_shift_px(c.camera->model, m.radial);
  if (!(shift > kDistortionTolerance_px) ||
      std::abs(m.radial) < kMinSigmas * c.fit.lens_sigma(kRadial))
    return;
  const CameraModel::Parameters p = with_lens(c.camera->model, m.focal, m.radial).parameters();
  report.add(
      {Severity::warning,
       c.name,
       "distortion",
       fmt::format("the error of directions grows with the distance from the center: {:.0f} "
                   "px in the corners",
                   shift),
       fmt::format("calibrate the camera in water, with distortion; the rotations fit {:.3f} "
                   "as the first of {}.coefficients (sigma {:.3f})",
                   p.coefficients[0], c.name, c.fit.lens_sigma(kRadial)),
       {{"coefficient", p.coefficients[0]},
        {"sigma", c.fit.lens_sigma(kRadial)},
        {"shift_px", shift}}});
}

// A wrong focal length also shows in the gyro scale: with the rig's lens it is off, with a free
// lens it is not.
bool lens_explains_scale(const CameraGyroFit& fit) {
  const double off = fit.model.gyro_scale - 1.0;
  return differs(off, fit.sigma(kGyroScale), kFocalTolerance) &&
         std::abs(fit.lens_model.gyro_scale - 1.0) < 0.5 * std::abs(off);
}

bool lens_is_wrong(const CameraGyroFit& fit, const CameraModel& camera) {
  const CameraGyroModel& m = fit.lens_model;
  if (fit.lens_sigma(kFocal) > kMaxFocalSigma) return false;
  if (fit.lens_gain < kMinSigmas && !lens_explains_scale(fit)) return false;
  return differs(m.focal - 1.0, fit.lens_sigma(kFocal), kFocalTolerance) ||
         (lens_shift_px(camera, m.radial) > kDistortionTolerance_px &&
          std::abs(m.radial) > kMinSigmas * fit.lens_sigma(kRadial));
}

// What was measured, whether or not it agrees with the rig.
void report_measured(const Checked& c, Report& report) {
  const CameraGyroModel& m = c.model();
  const Vector3d turn = c.turn();
  report.add(
      {Severity::ok,
       c.name,
       "gyro",
       fmt::format("relative to the gyro the images are {} (sigma {:.4f}) and the camera is {}; "
                   "{} pairs of images agree to {:.2f} px, with the rig's calibration to {:.2f}",
                   describe_offset(m.time_offset_s, 3), c.sigma()(kTimeOffset),
                   describe_turn(c, turn), c.fit.pairs, c.fit.rms_px, c.fit.rms_with_rig_px),
       "",
       {{"time_offset_s", m.time_offset_s},
        {"time_offset_sigma_s", c.sigma()(kTimeOffset)},
        {"turn_deg", turn.norm() / kRadiansPerDegree},
        {"turn_sigma_deg", c.turn_sigma() / kRadiansPerDegree},
        {"gyro_scale", m.gyro_scale},
        {"gyro_scale_sigma", c.sigma()(kGyroScale)},
        {"focal_ratio", c.fit.lens_model.focal},
        {"focal_ratio_sigma", c.fit.lens_sigma(kFocal)},
        {"lens_gain_sigmas", c.fit.lens_gain},
        {"rms_px", c.fit.rms_px},
        {"rms_as_rig_px", c.fit.rms_with_rig_px}}});
}

void check_camera(const CheckInput& input, std::size_t index, const InertialPath& path,
                  Report& report) {
  const CameraCalibration& camera = input.rig.cameras[index];
  Checked c;
  c.name = fmt::format("cam{}", index);
  c.camera = &camera;
  c.rig.time_offset_s = camera.time_offset_s;
  c.rig.R_camera_body = camera.T_body_camera.rotation.conjugate();
  const CameraGyroProblem problem(path, input.image_pairs[index], camera.model);
  const auto fit = fit_camera_against_gyro(problem, c.rig);
  if (!fit) {
    return not_observable(
        c.name, "gyro",
        fmt::format("{} pairs of images have enough corners in common", problem.pairs().size()),
        "needs images of a textured scene while the vehicle turns", report);
  }
  if (fit->uniqueness < kMinUniqueness && !fit->is_near_rig) {
    return not_observable(c.name, "gyro",
                          "other rotations and time offsets explain the images as well",
                          "record turns about two axes that start and stop", report);
  }
  c.fit = *fit;
  c.lens_is_wrong = lens_is_wrong(*fit, camera.model);
  report_measured(c, report);
  report_time(c, report);
  report_turn(c, input, problem, report);
  report_gyro_scale(c, report);
  if (!c.lens_is_wrong) return;
  report_focal(c, report);
  report_distortion(c, report);
}

}  // namespace

void check_camera_motion(const CheckInput& c, Report& report) {
  if (c.image_pairs.empty()) return;
  if (report.has_error("imu0")) {
    report.add(
        {Severity::note, "cam0", "gyro", "not checked: resolve the IMU's errors first", "", {}});
    return;
  }
  const InertialPath path(c.observed.imu.buffer);
  for (std::size_t i = 0; i < c.image_pairs.size(); ++i) {
    if (!report.has_error(fmt::format("cam{}", i))) check_camera(c, i, path, report);
  }
}

}  // namespace apvi::doctor
