// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/sensor_rig.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "apvi/core/log.hpp"
#include "importer/dive_writer.hpp"

namespace apvi::importer {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Rotation to the body of axes forward, right, down.
Matrix3d rotation_of_frd(BodyAxes axes) {
  Matrix3d R = Matrix3d::Identity();
  if (axes == BodyAxes::forward_left_up) R.diagonal() << 1.0, -1.0, -1.0;
  if (axes == BodyAxes::camera) R << 0, 1, 0, /**/ 0, 0, 1, /**/ 1, 0, 0;
  return R;
}

std::string pose_text(const Matrix3d& R, const Vector3d& p) {
  std::array<double, 16> m{};
  for (Eigen::Index row = 0; row < 3; ++row) {
    const auto at = static_cast<std::size_t>(4 * row);
    for (Eigen::Index column = 0; column < 3; ++column) {
      m[at + static_cast<std::size_t>(column)] = R(row, column) + 0.0;  // no -0
    }
    m[at + 3] = p[row] + 0.0;
  }
  m[15] = 1.0;
  return fmt::format("T_body_sensor: [{:.6g}]", fmt::join(m, ", "));
}

std::string imu_section(const SensorData& data) {
  constexpr double kSlow_hz = 20.0;
  const double rate = rate_hz(data.imu);
  if (rate < kSlow_hz) {
    log::warning(
        "imu0: {:.3g} samples per second cannot follow fast turns; log faster, take the log on "
        "board (.BIN), or run without the IMU: --set sensors.use=[camera,dvl,pressure]",
        rate);
  }
  const char* device = data.is_forward_right_down ? "the autopilot" : "the vehicle";
  return imu_yaml(std::clamp(rate, 1.0, 10000.0),
                  fmt::format("IMU of {}; its noise is ASSUMED", device));
}

std::string dvl_section(const SensorData& data, BodyAxes axes) {
  const char* where = data.p_body_dvl ? "position as in the autopilot's parameters VISO_POS"
                                      : "position ASSUMED at the origin of the body";
  const Matrix3d R = rotation_of_frd(axes);
  return fmt::format("# axes ASSUMED forward, right, down; {}\ndvl0:\n  {}\n", where,
                     pose_text(R, R * data.p_body_dvl.value_or(Vector3d::Zero())));
}

std::string pressure_section(const SensorData& data) {
  const PressureCalibration usual;
  const char* water = data.water_density ? "as in the autopilot's parameters" : "ASSUMED";
  return fmt::format(
      "# position ASSUMED at the origin of the body; density of the water {}\npressure0:\n"
      "  p_body_sensor: [0, 0, 0]\n  water_density: {:.6g}\n  atmospheric_pressure_pa: {:.6g}\n",
      water, data.water_density.value_or(usual.water_density),
      data.surface_pressure_pa.value_or(usual.atmospheric_pressure_pa));
}

}  // namespace

BodyAxes body_axes(const SensorData& data, bool has_images) {
  if (data.imu.empty()) return has_images ? BodyAxes::camera : BodyAxes::forward_right_down;
  if (data.is_forward_right_down) return BodyAxes::forward_right_down;
  constexpr double kUpright = 0.8;  // cosine
  Vector3d sum = Vector3d::Zero();
  for (const ImuSample& sample : data.imu) sum += sample.accel;
  const double cosine = sum.z() / std::max(sum.norm(), 1e-9);
  if (std::abs(cosine) < kUpright) {
    log::warning(
        "imu0: gravity is not along its z axis, so its mounting is not known; forward, left, up "
        "is ASSUMED: correct T_body_sensor of the other sensors in rig.yaml");
  }
  return cosine < -kUpright ? BodyAxes::forward_right_down : BodyAxes::forward_left_up;
}

BodyAxes body_axes(const Rig& rig) {
  return rig.world == WorldFrame::ned ? BodyAxes::forward_right_down : BodyAxes::forward_left_up;
}

std::string camera_pose(BodyAxes axes) {
  return pose_text(rotation_of_frd(axes) * rotation_of_frd(BodyAxes::camera).transpose(),
                   Vector3d::Zero());
}

std::string sensor_yaml(const SensorData& data, BodyAxes axes, const std::optional<Rig>& given) {
  std::string yaml;
  if (!given && axes == BodyAxes::forward_right_down) yaml += "world: ned\n";
  if (!given && axes == BodyAxes::forward_left_up) yaml += "world: up\n";
  if (!data.imu.empty() && !(given && given->imu)) yaml += imu_section(data);
  if (!data.dvl.empty() && !(given && given->dvl)) yaml += dvl_section(data, axes);
  if (!data.pressure.empty() && !(given && given->pressure)) yaml += pressure_section(data);
  if (!data.depth.empty() && !(given && given->depth)) {
    yaml += "# position ASSUMED at the origin of the body\ndepth0:\n  p_body_sensor: [0, 0, 0]\n";
  }
  return yaml;
}

}  // namespace apvi::importer
