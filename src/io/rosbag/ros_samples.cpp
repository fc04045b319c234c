// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/ros_samples.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "io/folder/csv_file.hpp"
#include "io/folder/image_decode.hpp"
#include "io/rosbag/ros_fields.hpp"

namespace apvi::io {
namespace {

// An invalid size (negative, not a number) becomes zero, which no image has.
std::size_t size_at(const RosValue& message, std::string_view path) {
  const double size = message.number_at(path).value_or(0.0);
  return size > 0.0 && size < 1e9 ? static_cast<std::size_t>(size) : 0;
}

}  // namespace

std::optional<Stamp> stamp_of_message(const RosValue& message, Stamp recorded) {
  const RosValue* value = first_of(message, {"header.stamp", "system_timestamp"});
  const auto ns = value == nullptr ? std::nullopt : value->nanoseconds();
  if (!ns || *ns == 0) return recorded;
  if (*ns > kMaxStampNs) return std::nullopt;
  return Stamp{*ns};
}

std::optional<SensorEvent> imu_of(const RosValue& message, Stamp stamp) {
  const auto gyro = vector_of(message.find("angular_velocity"));
  const auto accel = vector_of(message.find("linear_acceleration"));
  if (!gyro || !accel) return std::nullopt;
  return ImuSample{stamp, *gyro, *accel};
}

MessageToEvent imu_with(ImuFactors factors) {
  return [factors](const RosValue& message, Stamp stamp) {
    auto event = imu_of(message, stamp);
    if (!event) return event;
    auto& sample = std::get<ImuSample>(*event);
    sample.gyro *= factors.gyro;
    sample.accel *= factors.accel;
    return event;
  };
}

std::optional<SensorEvent> depth_of(const RosValue& message, Stamp stamp) {
  const auto p = vector_of(first_of(message, {"pose.pose.position", "pose.position"}));
  if (!p) return std::nullopt;
  return PressureDepthSample{stamp, -p->z()};
}

MessageToEvent pressure_of(const PressureScale& scale) {
  return [scale](const RosValue& message, Stamp stamp) -> std::optional<SensorEvent> {
    const auto value = message.number_at("fluid_pressure");
    if (!value) return std::nullopt;
    return PressureSample{stamp, scale.pascal(*value)};
  };
}

MessageToEvent image_of(int camera, std::string topic) {
  return [camera, topic = std::move(topic), depth = std::make_shared<BitDepth>()](
             const RosValue& message, Stamp stamp) -> std::optional<SensorEvent> {
    const RosValue* data = message.find("data");
    if (data == nullptr || data->bytes().empty()) return std::nullopt;
    RawImage raw;
    raw.name = fmt::format("{} at {:.9f}", topic, stamp.seconds());
    const RosValue* format = message.find("format");
    raw.compressed = format != nullptr;
    raw.depth = depth;
    if (raw.compressed) {
      raw.encoding = std::string(format->text().value_or(""));
    } else {
      raw.width = size_at(message, "width");
      raw.height = size_at(message, "height");
      raw.step = size_at(message, "step");
      raw.big_endian = size_at(message, "is_bigendian") != 0;
      const RosValue* encoding = message.find("encoding");
      raw.encoding = encoding == nullptr ? "" : std::string(encoding->text().value_or(""));
    }
    raw.bytes.assign(data->bytes().begin(), data->bytes().end());
    if (!raw.compressed && !is_well_formed(raw)) return std::nullopt;
    auto shared = std::make_shared<const RawImage>(std::move(raw));
    return ImageFrame{stamp, camera, [shared] { return decode_raw_image(*shared); }};
  };
}

std::pair<std::string, std::string> problem_of(const RosValue& message) {
  const RosValue* data = message.find("data");
  const std::size_t bytes = data == nullptr ? 0 : data->bytes().size();
  const auto text_at = [&](std::string_view path) {
    return std::string(message.find(path)->text().value_or(""));
  };
  if (message.find("format") != nullptr) return {"the image has no data", text_at("format")};
  if (message.find("encoding") == nullptr) return {"numbers of the sensor are missing", ""};
  return {"the image has another size than its data",
          fmt::format("{} x {} {}, step {}, {} bytes", size_at(message, "width"),
                      size_at(message, "height"), text_at("encoding"), size_at(message, "step"),
                      bytes)};
}

std::optional<SE3> pose_of(const RosValue& message) {
  const RosValue* pose = first_of(message, {"pose.pose", "pose", "transform"});
  if (pose == nullptr) return std::nullopt;
  const auto p = vector_of(first_of(*pose, {"position", "translation"}));
  const RosValue* rotation = first_of(*pose, {"orientation", "rotation"});
  const auto v = vector_of(rotation);
  const auto w = rotation == nullptr ? std::nullopt : rotation->number_at("w");
  if (!p || !v || !w || !p->allFinite()) return std::nullopt;
  const Eigen::Quaterniond q(*w, v->x(), v->y(), v->z());
  if (!(std::abs(q.norm() - 1.0) < 0.02)) return std::nullopt;
  return SE3{q.normalized(), *p};
}

}  // namespace apvi::io
