// SPDX-License-Identifier: BSD-3-Clause
#include "importer/telemetry.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"

namespace apvi::importer {
namespace {

bool has_unit(const GpmfStream& stream, const std::string& unit) {
  return stream.unit.empty() || stream.unit.starts_with(unit);
}

// Rotation of an IMU's stream to the camera; nullopt, which drops its samples, for unknown axes or
// another unit. "m/s" is the beginning of the spellings of m/s².
std::optional<Eigen::Matrix3d> imu_rotation(const GpmfStream& stream, const std::string& device) {
  if (!has_unit(stream, stream.key == "GYRO" ? "rad/s" : "m/s")) return std::nullopt;
  return rotation_to_camera(stream, device);
}

// Vectors of a stream with their times; those of the IMU in the camera's axes.
std::vector<TimedVector> vectors(const std::vector<TimedPayload>& payloads, const std::string& key,
                                 bool rotate) {
  std::vector<TimedVector> out;
  const std::vector<double> times = sample_times(payloads, key);
  std::size_t next = 0;
  for (const TimedPayload& p : payloads) {
    const GpmfStream* stream = p.payload.find(key);
    if (stream == nullptr) continue;
    const auto R = rotate ? imu_rotation(*stream, p.payload.device)
                          : Eigen::Matrix3d(Eigen::Matrix3d::Identity());
    for (std::size_t i = 0; i < stream->size(); ++i, ++next) {
      if (stream->channels != 3 || !R) continue;
      const Eigen::Vector3d value = *R * Eigen::Vector3d(&stream->values[3 * i]);
      if (value.allFinite()) out.push_back({times[next], value});
    }
  }
  return out;
}

struct TimedNumber {
  double time_s = 0.0;
  double value = 0.0;
};

std::vector<TimedNumber> numbers(const std::vector<TimedPayload>& payloads,
                                 const std::string& key) {
  std::vector<TimedNumber> out;
  const std::vector<double> times = sample_times(payloads, key);
  std::size_t next = 0;
  for (const TimedPayload& p : payloads) {
    const GpmfStream* stream = p.payload.find(key);
    for (std::size_t i = 0; stream != nullptr && i < stream->size(); ++i, ++next) {
      const double value = stream->values[i * stream->channels];
      if (std::isfinite(value)) out.push_back({times[next], value});
    }
  }
  return out;
}

// The last sample at or before a time, with tolerance for clocks that differ by less than an image.
template <typename T>
const T* at(const std::vector<T>& samples, double time_s) {
  constexpr double kTolerance_s = 2e-3;
  const auto after = std::upper_bound(samples.begin(), samples.end(), time_s + kTolerance_s,
                                      [](double t, const T& s) { return t < s.time_s; });
  return after == samples.begin() ? nullptr : &*(after - 1);
}

std::optional<Eigen::Vector3d> interpolate(const std::vector<TimedVector>& samples, double time_s) {
  const auto after = std::lower_bound(samples.begin(), samples.end(), time_s,
                                      [](const TimedVector& s, double t) { return s.time_s < t; });
  if (after == samples.end()) return std::nullopt;
  if (after->time_s == time_s) return after->value;
  if (after == samples.begin()) return std::nullopt;
  const TimedVector& a = *(after - 1);
  const double w = (time_s - a.time_s) / (after->time_s - a.time_s);
  return Eigen::Vector3d((1.0 - w) * a.value + w * after->value);
}

std::vector<ImuRow> join_imu(const std::vector<TimedPayload>& payloads) {
  const std::vector<TimedVector> gyro = vectors(payloads, "GYRO", true);
  const std::vector<TimedVector> accel = vectors(payloads, "ACCL", true);
  std::vector<ImuRow> rows;
  for (const TimedVector& g : gyro) {
    if (const auto a = interpolate(accel, g.time_s)) rows.push_back({g.time_s, g.value, *a});
  }
  return rows;
}

std::vector<ExposureRow> join_exposure(const std::vector<TimedPayload>& payloads) {
  std::vector<TimedNumber> iso = numbers(payloads, "ISOE");
  if (iso.empty()) iso = numbers(payloads, "ISOG");
  const std::vector<TimedNumber> shutter = numbers(payloads, "SHUT");
  const std::vector<TimedNumber> balance = numbers(payloads, "WBAL");
  const std::vector<TimedVector> gains = vectors(payloads, "WRGB", false);
  std::vector<ExposureRow> rows;
  for (const TimedNumber& image : shutter.empty() ? iso : shutter) {
    ExposureRow row{.time_s = image.time_s};
    if (const auto* s = at(shutter, row.time_s)) row.shutter_s = s->value;
    if (const auto* s = at(iso, row.time_s)) row.iso = s->value;
    if (const auto* s = at(balance, row.time_s)) row.white_balance_k = s->value;
    if (const auto* s = at(gains, row.time_s)) row.gains = s->value;
    rows.push_back(row);
  }
  return rows;
}

// By the vector part of quaternions w, x, y, z.
double image_rotation(const std::vector<TimedPayload>& payloads) {
  double greatest = 0.0;
  for (const TimedPayload& p : payloads) {
    const GpmfStream* stream = p.payload.find("IORI");
    if (stream == nullptr || stream->channels != 4) continue;
    for (std::size_t i = 0; i < stream->size(); ++i) {
      const double sine = Eigen::Vector3d(&stream->values[4 * i + 1]).norm();
      if (std::isfinite(sine)) greatest = std::max(greatest, 2.0 * std::asin(std::min(1.0, sine)));
    }
  }
  return greatest;
}

void warn_about_unused_imu(const std::vector<TimedPayload>& payloads) {
  for (const char* key : {"GYRO", "ACCL"}) {
    for (const TimedPayload& p : payloads) {
      const GpmfStream* stream = p.payload.find(key);
      if (stream == nullptr || imu_rotation(*stream, p.payload.device)) continue;
      log::warning("{}: not used; its axes (ORIN \"{}\") or its unit (\"{}\") are unknown", key,
                   stream->orientation_in, stream->unit);
      break;
    }
  }
}

}  // namespace

Telemetry join_telemetry(const std::vector<TimedPayload>& payloads) {
  Telemetry out;
  if (!payloads.empty()) out.device = payloads.front().payload.device;
  warn_about_unused_imu(payloads);
  out.imu = join_imu(payloads);
  out.exposure = join_exposure(payloads);
  out.image_rotation_rad = image_rotation(payloads);
  return out;
}

std::optional<Telemetry> read_telemetry(const std::filesystem::path& path, const Mp4Movie& movie) {
  const Mp4Track* track = movie.with_format("gpmd");
  if (track == nullptr) return std::nullopt;
  std::ifstream file(path, std::ios::binary);
  std::vector<TimedPayload> payloads;
  std::size_t damaged = 0;
  for (const Mp4Sample& sample : track->samples) {
    try {
      const std::vector<std::uint8_t> bytes = read_sample(file, sample, path.string());
      payloads.push_back({parse_gpmf(bytes), sample.time_s, sample.duration_s});
    } catch (const InputError& e) {
      if (damaged++ == 0) log::warning("{}; skipped", e.what());
    }
  }
  return join_telemetry(payloads);
}

}  // namespace apvi::importer
