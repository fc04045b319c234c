// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apvi/config/node.hpp"
#include "apvi/core/constants.hpp"
#include "apvi/core/stamp.hpp"
#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "apvi/sensors/port.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi {

/// Axis convention of the world frame. `up`: z up (x, y horizontal). `ned`: x north, y east, z
/// down, usually with a forward-right-down body frame.
enum class WorldFrame { up, ned };

struct ImuCalibration {
  double rate_hz = 100.0;
  double gyro_noise_density = 1e-3;   ///< [rad/s/sqrt(Hz)]
  double gyro_random_walk = 1e-5;     ///< [rad/s²/sqrt(Hz)]
  double accel_noise_density = 1e-2;  ///< [m/s²/sqrt(Hz)]
  double accel_random_walk = 1e-4;    ///< [m/s³/sqrt(Hz)]
};

/// The port of a camera.
struct PortCalibration {
  PortCamera camera;
  Eigen::Vector3d p_camera_lens;  ///< lens center in the frame of `CameraCalibration::model` [m]
  double working_range_m;         ///< the range for which that model was made
};

struct CameraCalibration {
  /// The camera as it sees. Behind a port it is the nearest central camera, and so is its pose.
  CameraModel model;
  SE3 T_body_camera;
  double rate_hz = 20.0;
  double time_offset_s = 0.0;  ///< true time = stamp - offset
  std::optional<PortCalibration> port{};
  /// [height,width], 8 bit: 255 where images show the scene, 0 where they always show something
  /// else, such as a part of the vehicle or an overlay. Empty: all of it is the scene.
  cv::Mat mask{};

  /// The camera in air and its pose; without a port, `model` and `T_body_camera`.
  const CameraModel& lens() const { return port ? port->camera.lens() : model; }
  SE3 T_body_lens() const {
    if (!port) return T_body_camera;
    return {T_body_camera.rotation, T_body_camera * port->p_camera_lens};
  }
};

struct DvlCalibration {
  SE3 T_body_dvl;
  double time_offset_s = 0.0;    ///< true time = stamp - offset
  double velocity_noise = 0.01;  ///< standard deviation of a component or beam [m/s]
  /// Unit vectors in the sensor frame; a beam measures its dot product with the sensor's velocity.
  std::array<Eigen::Vector3d, kDvlBeams> beams;
  double scale = 1.0;  ///< true velocity / reported velocity = sound speed / assumed sound speed
  /// Signs of the reported components, for devices or logs with left-handed axes.
  Eigen::Vector3d axis_signs = Eigen::Vector3d::Ones();

  /// Sensor velocity in its right-handed frame [m/s] from the reported velocity.
  Eigen::Vector3d true_velocity(const Eigen::Vector3d& reported) const {
    return scale * axis_signs.cwiseProduct(reported);
  }
};

struct PressureCalibration {
  Eigen::Vector3d p_body_sensor = Eigen::Vector3d::Zero();  ///< [m]
  double water_density = 1025.0;                            ///< [kg/m³]
  double gravity = kStandardGravity;                        ///< [m/s²]
  double atmospheric_pressure_pa = 101325.0;                ///< [Pa]
  double noise_m = 0.01;                                    ///< standard deviation, as depth [m]

  /// Depth of the sensor below the surface [m].
  double depth(double pressure_pa) const {
    return (pressure_pa - atmospheric_pressure_pa) / (water_density * gravity);
  }
};

struct PressureDepthCalibration {
  Eigen::Vector3d p_body_sensor = Eigen::Vector3d::Zero();  ///< [m]
  double noise_m = 0.01;                                    ///< standard deviation [m]
};

/// A lamp on the vehicle that illuminates the scene along its z axis.
struct LampCalibration {
  SE3 T_body_lamp;
  double half_beam_rad = 1.0;  ///< half-intensity angle from the axis
  double intensity = 1.0;      ///< on the axis, relative to the other lamps
};

/// Calibration of a vehicle. The body frame is the IMU's.
struct Rig {
  WorldFrame world = WorldFrame::up;
  std::optional<ImuCalibration> imu;
  std::vector<CameraCalibration> cameras;  ///< cam0, cam1
  std::optional<DvlCalibration> dvl;
  std::optional<PressureCalibration> pressure;
  std::optional<PressureDepthCalibration> depth;
  std::vector<LampCalibration> lamps;

  /// Gravity in world coordinates [m/s²] for the given magnitude.
  Eigen::Vector3d gravity(double magnitude) const {
    return {0.0, 0.0, world == WorldFrame::ned ? magnitude : -magnitude};
  }
  /// +1 when a larger world z means deeper (ned), else -1.
  double down_sign() const { return world == WorldFrame::ned ? 1.0 : -1.0; }
};

/// Janus geometry of the Water Linked A50: beams tilted by 22.5 degrees from the vertical, at
/// azimuths of 45 degrees plus multiples of 90.
std::array<Eigen::Vector3d, kDvlBeams> default_dvl_beams();

/// Reads a rig from configuration nodes (the content of rig.yaml). Rotations are
/// re-orthonormalized. Throws InputError with file and line for unknown keys, values out of range,
/// matrices that are not rigid transforms, and beams that are not unit vectors.
Rig make_rig(const config::Node& node);
/// The documentation of every key of rig.yaml as a Markdown table.
std::string rig_documentation();

}  // namespace apvi
