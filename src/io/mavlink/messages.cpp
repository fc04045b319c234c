// SPDX-License-Identifier: BSD-3-Clause
#include "io/mavlink/messages.hpp"

#include <algorithm>
#include <utility>

#include "apvi/core/constants.hpp"

namespace apvi::io::mavlink {
namespace {

// As for apvi's programs on board: no autopilot, MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY.
constexpr std::uint8_t kSystem = 1;
constexpr std::uint8_t kComponent = 197;
constexpr std::uint8_t kTypeOnboardController = 18;
constexpr std::uint8_t kNoAutopilot = 8;
constexpr std::uint8_t kActive = 4;
constexpr std::uint8_t kProtocolVersion = 3;

constexpr std::pair<std::string_view, Id> kSensorMessages[] = {
    {"HIGHRES_IMU", Id::highres_imu},
    {"RAW_IMU", Id::raw_imu},
    {"SCALED_IMU", Id::scaled_imu},
    {"SCALED_IMU2", Id::scaled_imu2},
    {"SCALED_IMU3", Id::scaled_imu3},
    {"SCALED_PRESSURE", Id::scaled_pressure},
    {"SCALED_PRESSURE2", Id::scaled_pressure2},
    {"SCALED_PRESSURE3", Id::scaled_pressure3}};

// The protocol lets `time_usec` be either; a time since boot is below that of 2001.
Time time_from_us(std::uint64_t us) {
  constexpr std::uint64_t kUnix2001_us = 1'000'000'000'000'000;
  constexpr std::uint64_t kMax_us = 9'000'000'000'000'000;
  const auto ns = static_cast<std::int64_t>(1000 * std::min(us, kMax_us));
  return {Stamp{ns}, us >= kUnix2001_us ? Clock::unix : Clock::boot};
}

Stamp stamp_from_ms(std::uint32_t ms) {
  return {std::int64_t{1'000'000} * ms};
}

template <typename T>
Eigen::Vector3d vector_at(const Frame& frame, std::size_t offset) {
  const auto at = [&](std::size_t i) {
    return static_cast<double>(frame.get<T>(offset + i * sizeof(T)));
  };
  return {at(0), at(1), at(2)};
}

// Accelerations in milli-g and rates in mrad/s, from the offset on.
Imu integer_imu(const Frame& frame, const Time& time, std::size_t offset) {
  return {.id = frame.id,
          .time = time,
          .gyro = 1e-3 * vector_at<std::int16_t>(frame, offset + 6),
          .accel = 1e-3 * kStandardGravity * vector_at<std::int16_t>(frame, offset)};
}

std::optional<Message> highres_imu(const Frame& frame) {
  constexpr unsigned kInertial = 0x3F;
  if ((frame.get<std::uint16_t>(60) & kInertial) != kInertial) return std::nullopt;
  return Imu{.id = frame.id,
             .time = time_from_us(frame.get<std::uint64_t>(0)),
             .gyro = vector_at<float>(frame, 20),
             .accel = vector_at<float>(frame, 8)};
}

Pressure pressure(const Frame& frame) {
  constexpr double kPaPerHpa = 100.0;
  return {.id = frame.id,
          .time = {stamp_from_ms(frame.get<std::uint32_t>(0)), Clock::boot},
          .pressure_pa = kPaPerHpa * static_cast<double>(frame.get<float>(4))};
}

SystemTime system_time(const Frame& frame) {
  SystemTime time{.boot = stamp_from_ms(frame.get<std::uint32_t>(8)), .unix_time = {}};
  const Time given = time_from_us(frame.get<std::uint64_t>(0));
  if (given.clock == Clock::unix) time.unix_time = given.stamp;
  return time;
}

Gps gps(const Frame& frame) {
  constexpr double kDegrees = 1e-7;
  constexpr double kMeters = 1e-3;
  constexpr std::uint8_t kFix3d = 3;
  return {.time = time_from_us(frame.get<std::uint64_t>(0)),
          .latitude_deg = kDegrees * frame.get<std::int32_t>(8),
          .longitude_deg = kDegrees * frame.get<std::int32_t>(12),
          .altitude_m = kMeters * frame.get<std::int32_t>(16),
          .has_fix = frame.get<std::uint8_t>(28) >= kFix3d};
}

PositionDelta position_delta(const Frame& frame) {
  const auto us = frame.get<std::uint64_t>(0);
  return {.time = us == 0 ? std::nullopt : std::optional(time_from_us(us)),
          .duration_s = 1e-6 * static_cast<double>(frame.get<std::uint64_t>(8)),
          .position = vector_at<float>(frame, 28),
          .confidence = frame.get<float>(40)};
}

Parameter parameter(const Frame& frame) {
  constexpr std::size_t kName = 8;
  constexpr std::size_t kNameSize = 16;
  const auto* name = reinterpret_cast<const char*>(frame.payload.data() + kName);
  return {.name = {name, std::find(name, name + kNameSize, '\0')}, .value = frame.get<float>(0)};
}

}  // namespace

std::optional<Message> interpret(const Frame& frame) {
  switch (frame.id) {
    case Id::heartbeat:
      return Heartbeat{.type = frame.get<std::uint8_t>(4), .autopilot = frame.get<std::uint8_t>(5)};
    case Id::system_time:
      return system_time(frame);
    case Id::timesync:
      return TimeSync{.remote = {frame.get<std::int64_t>(0)},
                      .local = {frame.get<std::int64_t>(8)}};
    case Id::highres_imu:
      return highres_imu(frame);
    case Id::raw_imu:
      return integer_imu(frame, time_from_us(frame.get<std::uint64_t>(0)), 8);
    case Id::scaled_imu:
    case Id::scaled_imu2:
    case Id::scaled_imu3:
      return integer_imu(frame, {stamp_from_ms(frame.get<std::uint32_t>(0)), Clock::boot}, 4);
    case Id::scaled_pressure:
    case Id::scaled_pressure2:
    case Id::scaled_pressure3:
      return pressure(frame);
    case Id::gps_raw_int:
      return gps(frame);
    case Id::vision_position_delta:
      return position_delta(frame);
    case Id::param_value:
      return parameter(frame);
    default:
      return std::nullopt;
  }
}

Frame heartbeat() {
  Frame frame{.system = kSystem, .component = kComponent, .id = Id::heartbeat};
  frame.set<std::uint8_t>(4, kTypeOnboardController);
  frame.set<std::uint8_t>(5, kNoAutopilot);
  frame.set<std::uint8_t>(7, kActive);
  frame.set<std::uint8_t>(8, kProtocolVersion);
  return frame;
}

Frame time_request(Stamp now) {
  Frame frame{.system = kSystem, .component = kComponent, .id = Id::timesync};
  frame.set<std::int64_t>(8, now.ns);
  return frame;
}

const std::vector<Id>& imu_messages() {
  static const std::vector<Id> messages = {Id::highres_imu, Id::raw_imu, Id::scaled_imu,
                                           Id::scaled_imu2, Id::scaled_imu3};
  return messages;
}

const std::vector<Id>& pressure_messages() {
  static const std::vector<Id> messages = {Id::scaled_pressure2, Id::scaled_pressure3,
                                           Id::scaled_pressure};
  return messages;
}

std::optional<Id> sensor_message(std::string_view name) {
  const auto* found =
      std::ranges::find(kSensorMessages, name, [](const auto& m) { return m.first; });
  if (found == std::end(kSensorMessages)) return std::nullopt;
  return found->second;
}

std::string_view name_of(Id id) {
  const auto* found =
      std::ranges::find(kSensorMessages, id, [](const auto& m) { return m.second; });
  return found == std::end(kSensorMessages) ? "another message" : found->first;
}

}  // namespace apvi::io::mavlink
