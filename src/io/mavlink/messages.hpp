// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "io/mavlink/frame.hpp"

/// The messages that carry sensor data and times, in SI units. Axes are those of MAVLink: forward,
/// right, down.
namespace apvi::io::mavlink {

/// Clocks that an autopilot stamps messages by: time since boot, or Unix time.
enum class Clock : std::size_t { boot = 0, unix = 1 };

struct Time {
  Stamp stamp;
  Clock clock = Clock::boot;
};

struct Imu {
  Id id = Id::raw_imu;
  Time time;
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();   ///< [rad/s]
  Eigen::Vector3d accel = Eigen::Vector3d::Zero();  ///< specific force [m/s²]
};
struct Pressure {
  Id id = Id::scaled_pressure;
  Time time;
  double pressure_pa = 0.0;  ///< absolute
};
struct SystemTime {
  Stamp boot;
  std::optional<Stamp> unix_time;  ///< empty while the autopilot does not know it
};
struct TimeSync {
  Stamp remote;  ///< of the answer; 0 in a request
  Stamp local;   ///< of the request, as the one who asked stamped it
};
/// A satellite fix.
struct Gps {
  Time time;
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  double altitude_m = 0.0;  ///< above mean sea level
  bool has_fix = false;     ///< of three dimensions
};
/// Motion that a DVL or a camera has measured, in the body's axes at its end.
struct PositionDelta {
  std::optional<Time> time;  ///< empty: the sender has no clock
  double duration_s = 0.0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< [m]
  double confidence = 0.0;                             ///< [%]
};
/// A parameter of the autopilot.
struct Parameter {
  std::string name;
  double value = 0.0;
};
struct Heartbeat {
  std::uint8_t type = 0;
  std::uint8_t autopilot = 0;
};

using Message =
    std::variant<Heartbeat, SystemTime, TimeSync, Imu, Pressure, Gps, PositionDelta, Parameter>;

/// nullopt for other messages, and for HIGHRES_IMU without all of its six inertial readings.
std::optional<Message> interpret(const Frame& frame);

Frame heartbeat();  ///< of an onboard computer
Frame time_request(Stamp now);

/// The messages with data of an IMU, by resolution of stamps and values, best first.
const std::vector<Id>& imu_messages();
/// The messages with a pressure, best first. An autopilot's first barometer is inside its housing;
/// the second is in the water.
const std::vector<Id>& pressure_messages();
/// "RAW_IMU" and so on; nullopt for other names.
std::optional<Id> sensor_message(std::string_view name);
std::string_view name_of(Id id);

}  // namespace apvi::io::mavlink
