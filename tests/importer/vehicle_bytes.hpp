// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "io/mavlink/frame.hpp"

/// Logs of an autopilot, made byte by byte.
namespace apvi::test {

template <typename T>
std::string little_endian(T value) {
  std::string bytes(sizeof value, '\0');
  std::memcpy(bytes.data(), &value, sizeof value);
  return bytes;
}

inline std::string padded(std::string text, std::size_t size) {
  text.resize(size, '\0');
  return text;
}

/// A message of a DataFlash log: magic, type, fields.
inline std::string dataflash(std::uint8_t type, const std::string& fields) {
  return std::string("\xA3\x95") + static_cast<char>(type) + fields;
}

/// The message FMT for a type with fields of `size` bytes.
inline std::string dataflash_format(std::uint8_t type, std::size_t size, const std::string& name,
                                    const std::string& letters, const std::string& columns) {
  return dataflash(128, std::string{static_cast<char>(type), static_cast<char>(size + 3)} +
                            padded(name, 4) + padded(letters, 16) + padded(columns, 64));
}

/// A part of a log with the formats of today's ArduPilot.
inline std::string dataflash_formats() {
  return dataflash_format(129, 51, "IMU", "QBffffffIIfBBHH",
                          "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz") +
         dataflash_format(130, 13, "BARO", "QBf", "TimeUS,I,Press") +
         dataflash_format(131, 40, "VISO", "Qffffffff",
                          "TimeUS,dt,AngDX,AngDY,AngDZ,PosDX,PosDY,PosDZ,conf") +
         dataflash_format(132, 28, "GPS", "QBBIHLLe", "TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt") +
         dataflash_format(133, 28, "PARM", "QNf", "TimeUS,Name,Value") +
         dataflash_format(134, 29, "GYR", "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ") +
         dataflash_format(135, 29, "ACC", "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ");
}

inline std::string floats(const std::vector<float>& values) {
  std::string bytes;
  for (const float value : values) bytes += little_endian(value);
  return bytes;
}

inline std::string dataflash_imu(std::uint64_t us, std::uint8_t instance,
                                 const std::vector<float>& gyro_accel) {
  return dataflash(129, little_endian(us) + little_endian(instance) + floats(gyro_accel) +
                            std::string(18, '\0'));
}
inline std::string dataflash_baro(std::uint64_t us, std::uint8_t instance, float pressure_pa) {
  return dataflash(130, little_endian(us) + little_endian(instance) + floats({pressure_pa}));
}
inline std::string dataflash_viso(std::uint64_t us, float dt, const std::vector<float>& motion,
                                  float confidence) {
  return dataflash(131, little_endian(us) + floats({dt, 0.0F, 0.0F, 0.0F}) + floats(motion) +
                            floats({confidence}));
}
inline std::string dataflash_gps(std::uint64_t us, std::uint8_t status, std::uint32_t ms,
                                 std::uint16_t week, std::int32_t lat, std::int32_t lng,
                                 std::int32_t alt_cm) {
  return dataflash(132, little_endian(us) + std::string(1, '\0') + little_endian(status) +
                            little_endian(ms) + little_endian(week) + little_endian(lat) +
                            little_endian(lng) + little_endian(alt_cm));
}
inline std::string dataflash_parameter(const std::string& name, float value) {
  return dataflash(133, little_endian(std::uint64_t{1}) + padded(name, 16) + floats({value}));
}
/// GYR (134) or ACC (135).
inline std::string dataflash_raw(std::uint8_t type, std::uint64_t us, std::uint64_t sample_us,
                                 const std::vector<float>& vector) {
  return dataflash(
      type, little_endian(us) + std::string(1, '\0') + little_endian(sample_us) + floats(vector));
}

/// A message of a telemetry log: time of arrival, frame of version 2.
inline std::string telemetry(std::uint64_t arrival_us, const io::mavlink::Frame& frame) {
  std::string bytes;
  for (int shift = 56; shift >= 0; shift -= 8) {
    bytes += static_cast<char>(arrival_us >> static_cast<unsigned>(shift));
  }
  const std::vector<std::uint8_t> encoded = io::mavlink::encode(frame, 0);
  return bytes.append(encoded.begin(), encoded.end());
}

inline io::mavlink::Frame autopilot_frame(io::mavlink::Id id) {
  return {.system = 1, .component = 1, .id = id};
}
/// RAW_IMU: accelerations in milli-g, rates in mrad/s.
inline io::mavlink::Frame raw_imu_frame(std::uint64_t boot_us,
                                        const std::vector<std::int16_t>& values) {
  io::mavlink::Frame frame = autopilot_frame(io::mavlink::Id::raw_imu);
  frame.set(0, boot_us);
  for (std::size_t i = 0; i < values.size(); ++i) frame.set(8 + 2 * i, values[i]);
  return frame;
}
inline io::mavlink::Frame pressure_frame(io::mavlink::Id id, std::uint32_t boot_ms, float hpa) {
  io::mavlink::Frame frame = autopilot_frame(id);
  frame.set(0, boot_ms);
  frame.set(4, hpa);
  return frame;
}
/// VISION_POSITION_DELTA of a computer on board; `us` 0: without a stamp.
inline io::mavlink::Frame delta_frame(std::uint64_t us, std::uint64_t duration_us,
                                      const std::vector<float>& motion, float confidence) {
  io::mavlink::Frame frame{
      .system = 255, .component = 0, .id = io::mavlink::Id::vision_position_delta};
  frame.set(0, us);
  frame.set(8, duration_us);
  for (std::size_t i = 0; i < 3; ++i) frame.set(28 + 4 * i, motion[i]);
  frame.set(40, confidence);
  return frame;
}

}  // namespace apvi::test
