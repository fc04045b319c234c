// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/rig.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "apvi/config/fields.hpp"
#include "apvi/core/constants.hpp"
#include "sensors/camera_section.hpp"
#include "sensors/pose_node.hpp"
#include "sensors/sound_speed.hpp"

namespace apvi {
namespace {

using config::Choices;
using config::Node;
using config::Range;
using Triple = std::array<double, 3>;

// Sections of rig.yaml, which `make_rig` converts to a Rig.

struct ImuSection {
  ImuCalibration imu;
  template <typename V>
  void visit(V& v) {
    v("rate_hz", imu.rate_hz, Range{1.0, 10000.0}, "nominal sample rate [Hz]");
    v("gyro_noise_density", imu.gyro_noise_density, Range{1e-9, 1.0},
      "white noise [rad/s/sqrt(Hz)]");
    v("gyro_random_walk", imu.gyro_random_walk, Range{0.0, 1.0},
      "bias random walk [rad/s²/sqrt(Hz)]");
    v("accel_noise_density", imu.accel_noise_density, Range{1e-9, 10.0},
      "white noise [m/s²/sqrt(Hz)]");
    v("accel_random_walk", imu.accel_random_walk, Range{0.0, 10.0},
      "bias random walk [m/s³/sqrt(Hz)]");
  }
};

struct WaterSection {
  double temperature_c = 10.0;
  double salinity_psu = 35.0;
  double depth_m = 0.0;
  template <typename V>
  void visit(V& v) {
    v("temperature_c", temperature_c, Range{0.0, 40.0}, "water temperature [degC]");
    v("salinity_psu", salinity_psu, Range{0.0, 40.0}, "salinity [PSU]; 0 is fresh water");
    v("depth_m", depth_m, Range{0.0, 10000.0}, "depth [m]");
  }
};

struct DvlSection {
  Node T_body_sensor;
  double time_offset_s = 0.0;
  double velocity_noise = 0.01;
  std::array<int, 3> axis_signs = {1, 1, 1};
  std::optional<std::array<Triple, kDvlBeams>> beams;
  Node sound_speed;
  double assumed_sound_speed = 1500.0;
  template <typename V>
  void visit(V& v) {
    v("T_body_sensor", T_body_sensor, "DVL to body: 4x4 matrix, row-major");
    v("time_offset_s", time_offset_s, Range{-10.0, 10.0}, "delay of the stamps [s]");
    v("velocity_noise", velocity_noise, Range{1e-5, 10.0},
      "velocity noise per axis, one sigma [m/s]");
    v("axis_signs", axis_signs, Range{-1, 1},
      "sign of each reported axis, for logs with left-handed axes");
    v("beams", beams, "four unit vectors; beam velocity = vector · sensor velocity");
    v("sound_speed", sound_speed,
      "speed of sound in the water [m/s], or {temperature_c, salinity_psu, depth_m}; absent: "
      "assumed_sound_speed");
    v("assumed_sound_speed", assumed_sound_speed, Range{1300.0, 1700.0},
      "speed of sound configured in the device [m/s]");
  }
};

struct PressureSection {
  Triple p_body_sensor{};
  PressureCalibration calibration;
  template <typename V>
  void visit(V& v) {
    v("p_body_sensor", p_body_sensor, "position of the port in the body frame [m]");
    v("water_density", calibration.water_density, Range{900.0, 1200.0}, "water density [kg/m³]");
    v("gravity", calibration.gravity, Range{9.0, 10.5},
      "gravitational acceleration for converting pressure to depth [m/s²]");
    v("atmospheric_pressure_pa", calibration.atmospheric_pressure_pa, Range{0.0, 200000.0},
      "pressure at the surface [Pa]");
    v("noise_m", calibration.noise_m, Range{1e-5, 100.0}, "noise as depth, one sigma [m]");
  }
};

struct DepthSection {
  Triple p_body_sensor{};
  double noise_m = 0.01;
  template <typename V>
  void visit(V& v) {
    v("p_body_sensor", p_body_sensor, "position of the sensor in the body frame [m]");
    v("noise_m", noise_m, Range{1e-5, 100.0}, "noise, one sigma [m]");
  }
};

struct LampSection {
  Node T_body_sensor;
  double half_beam_deg = 60.0;
  double intensity = 1.0;
  template <typename V>
  void visit(V& v) {
    v("T_body_sensor", T_body_sensor,
      "lamp to body: 4x4 matrix, row-major; the lamp points along its z axis");
    v("half_beam_deg", half_beam_deg, Range{1.0, 89.0},
      "angle from the axis to half intensity [deg]");
    v("intensity", intensity, Range{1e-3, 1e3}, "on the axis, relative to the other lamps");
  }
};

struct RigFile {
  std::string body = "imu0";
  WorldFrame world = WorldFrame::up;
  std::optional<ImuSection> imu0;
  std::optional<CameraSection> cam0;
  std::optional<CameraSection> cam1;
  std::optional<DvlSection> dvl0;
  std::optional<PressureSection> pressure0;
  std::optional<DepthSection> depth0;
  std::array<std::optional<LampSection>, 4> lamps;
  template <typename V>
  void visit(V& v) {
    v("body", body, "sensor whose frame is the body frame; only imu0");
    v("world", world, Choices<WorldFrame>{{"up", WorldFrame::up}, {"ned", WorldFrame::ned}},
      "world axes: z up, or north-east-down");
    v("imu0", imu0, "IMU");
    v("cam0", cam0, "first camera");
    v("cam1", cam1, "second camera of a stereo pair");
    v("dvl0", dvl0, "Doppler velocity log");
    v("pressure0", pressure0, "pressure sensor");
    v("depth0", depth0, "depth sensor (a pressure sensor that reports meters)");
    v("lamp0", lamps[0], "lamp, if daylight is not enough");
    v("lamp1", lamps[1], "second lamp");
    v("lamp2", lamps[2], "third lamp");
    v("lamp3", lamps[3], "fourth lamp");
  }
};

Eigen::Vector3d to_vector(const Triple& t) {
  return {t[0], t[1], t[2]};
}

double water_sound_speed(const DvlSection& section) {
  const std::string key = "dvl0.sound_speed";
  const Node& node = section.sound_speed;
  if (node.is_null()) return section.assumed_sound_speed;
  if (node.kind == Node::Kind::map) {
    WaterSection water;
    config::read(node, water, key);
    return sound_speed(water.temperature_c, water.salinity_psu, water.depth_m);
  }
  double speed = 0.0;
  config::internal::read_value(node, key, speed, Range{1300.0, 1700.0});
  return speed;
}

DvlCalibration to_dvl(const DvlSection& section, const Node& node) {
  DvlCalibration dvl;
  dvl.T_body_dvl = to_pose(section.T_body_sensor, "dvl0.T_body_sensor");
  dvl.time_offset_s = section.time_offset_s;
  dvl.velocity_noise = section.velocity_noise;
  dvl.beams = default_dvl_beams();
  dvl.scale = water_sound_speed(section) / section.assumed_sound_speed;
  for (std::size_t i = 0; i < 3; ++i) {
    if (section.axis_signs[i] == 0) fail_at(node, "dvl0.axis_signs", "each must be 1 or -1");
    dvl.axis_signs(static_cast<Eigen::Index>(i)) = section.axis_signs[i];
  }
  for (std::size_t i = 0; section.beams && i < kDvlBeams; ++i) {
    const Eigen::Vector3d beam = to_vector((*section.beams)[i]);
    if (std::abs(beam.norm() - 1.0) > 0.01) {
      fail_at(node, "dvl0.beams", fmt::format("beam {} has length {:.4f}, not 1", i, beam.norm()));
    }
    dvl.beams[i] = beam.normalized();
  }
  return dvl;
}

}  // namespace

std::array<Eigen::Vector3d, kDvlBeams> default_dvl_beams() {
  const double tilt = 22.5 * kRadiansPerDegree;
  const double s = std::sin(tilt) / std::numbers::sqrt2;
  const double c = std::cos(tilt);
  return {Eigen::Vector3d(-s, s, c), Eigen::Vector3d(-s, -s, c), Eigen::Vector3d(s, -s, c),
          Eigen::Vector3d(s, s, c)};
}

Rig make_rig(const Node& node) {
  RigFile file;
  config::read(node, file);
  const auto at = [&](std::string_view key) -> const Node& {
    const Node* member = node.find(key);
    return member != nullptr ? *member : node;
  };
  if (file.body != "imu0") fail_at(at("body"), "body", "only imu0 can be the body frame");
  Rig rig;
  rig.world = file.world;
  if (file.imu0) rig.imu = file.imu0->imu;
  if (file.cam1 && !file.cam0) fail_at(at("cam1"), "cam1", "there is no cam0; name this one cam0");
  if (file.cam0) rig.cameras.push_back(to_camera(*file.cam0, at("cam0"), "cam0"));
  if (file.cam1) rig.cameras.push_back(to_camera(*file.cam1, at("cam1"), "cam1"));
  if (file.dvl0) rig.dvl = to_dvl(*file.dvl0, at("dvl0"));
  if (file.pressure0) {
    rig.pressure = file.pressure0->calibration;
    rig.pressure->p_body_sensor = to_vector(file.pressure0->p_body_sensor);
  }
  if (file.depth0) {
    rig.depth = {.p_body_sensor = to_vector(file.depth0->p_body_sensor),
                 .noise_m = file.depth0->noise_m};
  }
  for (std::size_t i = 0; i < file.lamps.size(); ++i) {
    const std::optional<LampSection>& lamp = file.lamps[i];
    if (!lamp) continue;
    rig.lamps.push_back(
        {.T_body_lamp = to_pose(lamp->T_body_sensor, fmt::format("lamp{}.T_body_sensor", i)),
         .half_beam_rad = lamp->half_beam_deg * kRadiansPerDegree,
         .intensity = lamp->intensity});
  }
  return rig;
}

std::string rig_documentation() {
  return config::to_markdown(config::document(RigFile{}));
}

}  // namespace apvi
