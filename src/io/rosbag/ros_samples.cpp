// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/ros_samples.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "io/folder/csv_file.hpp"
#include "io/folder/dvl_validity.hpp"
#include "io/folder/image_decode.hpp"

namespace apvi::io {
namespace {

std::optional<Eigen::Vector3d> vector_of(const RosValue* value) {
  if (value == nullptr) return std::nullopt;
  const auto x = value->number_at("x");
  const auto y = value->number_at("y");
  const auto z = value->number_at("z");
  if (!x || !y || !z) return std::nullopt;
  return Eigen::Vector3d(*x, *y, *z);
}

const RosValue* first_of(const RosValue& message, std::initializer_list<std::string_view> paths) {
  for (const std::string_view path : paths) {
    if (const RosValue* value = message.find(path)) return value;
  }
  return nullptr;
}

// Covariance convention: zeros for "unknown", -1 in the first element for "no measurement".
bool covariance_says_invalid(const RosValue& message) {
  const RosValue* covariance =
      first_of(message, {"velocity_covariance", "twist.covariance", "covariance"});
  return covariance != nullptr && covariance->number().value_or(0.0) < 0.0;
}

std::optional<double> figure_of_merit_of(const RosValue& message) {
  if (const auto fom = message.number_at("fom")) return fom;
  const RosValue* covariance = first_of(message, {"velocity_covariance", "twist.covariance"});
  const double variance = covariance == nullptr ? 0.0 : covariance->number().value_or(0.0);
  return variance > 0.0 ? std::optional<double>(std::sqrt(variance)) : std::nullopt;
}

// Water-track velocity is relative to the water, not to the bottom.
bool is_water_track(const RosValue& message) {
  const RosValue* type = message.find("type");
  const auto word = type == nullptr ? std::nullopt : type->text();
  return word && word->find("water") != std::string_view::npos;
}

DvlBeam beam_of(const RosValue& message) {
  DvlBeam beam;
  beam.velocity = message.number_at("velocity").value_or(0.0);
  const RosValue* range = first_of(message, {"distance", "range"});
  beam.range = range == nullptr ? std::nullopt : range->number();
  const auto valid = message.number_at("valid");
  beam.valid = valid ? *valid != 0.0 : !covariance_says_invalid(message);
  return beam;
}

// Beams by id when the ids are unique and in 0 to 3, else in list order.
void add_beams(const RosValue& message, DvlSample& sample) {
  const RosValue* beams = message.find("beams");
  if (beams == nullptr) return;
  const auto& items = beams->items();
  const std::size_t count = std::min(items.size(), kDvlBeams);
  std::array<std::size_t, kDvlBeams> place{};
  std::array<bool, kDvlBeams> taken{};
  bool by_id = true;
  for (std::size_t i = 0; i < count; ++i) {
    const double id = items[i].number_at("id").value_or(-1.0);
    by_id = by_id && id >= 0.0 && id < static_cast<double>(kDvlBeams) &&
            !std::exchange(taken[static_cast<std::size_t>(id)], true);
    place[i] = by_id ? static_cast<std::size_t>(id) : i;
  }
  for (std::size_t i = 0; i < count; ++i) {
    sample.beams[by_id ? place[i] : i] = beam_of(items[i]);
  }
}

// An invalid size (negative, not a number) becomes zero, which no image has.
std::size_t size_at(const RosValue& message, std::string_view path) {
  const double size = message.number_at(path).value_or(0.0);
  return size > 0.0 && size < 1e9 ? static_cast<std::size_t>(size) : 0;
}

}  // namespace

std::optional<Stamp> stamp_of_message(const RosValue& message, Stamp recorded) {
  const RosValue* value = message.find("header.stamp");
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

std::optional<SensorEvent> dvl_of(const RosValue& message, Stamp stamp) {
  const auto velocity =
      vector_of(first_of(message, {"velocity", "twist.twist.linear", "twist.linear"}));
  if (!velocity) return std::nullopt;
  DvlSample sample;
  sample.stamp = stamp;
  sample.velocity = *velocity;
  sample.figure_of_merit = figure_of_merit_of(message);
  sample.altitude = message.number_at("altitude");
  add_beams(message, sample);
  const auto valid = message.number_at("velocity_valid");
  sample.valid = (valid ? *valid != 0.0 : infer_validity(sample)) &&
                 !covariance_says_invalid(message) && !is_water_track(message);
  clear_placeholder_values(sample);
  return sample;
}

std::optional<SensorEvent> depth_of(const RosValue& message, Stamp stamp) {
  const auto p = vector_of(first_of(message, {"pose.pose.position", "pose.position"}));
  if (!p) return std::nullopt;
  return PressureDepthSample{stamp, -p->z()};
}

MessageToEvent pressure_of(PressureScale scale) {
  return [scale](const RosValue& message, Stamp stamp) -> std::optional<SensorEvent> {
    const auto value = message.number_at("fluid_pressure");
    if (!value) return std::nullopt;
    const double pascal = scale.pascal(*value);
    if (!scale.is_plausible(pascal)) return std::nullopt;
    return PressureSample{stamp, pascal};
  };
}

MessageToEvent image_of(int camera, std::string topic) {
  return [camera, topic = std::move(topic), depth = std::make_shared<BitDepth>()](
             const RosValue& message, Stamp stamp) -> std::optional<SensorEvent> {
    const RosValue* data = message.find("data");
    if (data == nullptr || data->bytes().empty()) return std::nullopt;
    RawImage raw;
    raw.name = fmt::format("{} at {:.9f}", topic, stamp.seconds());
    raw.compressed = message.find("format") != nullptr;
    raw.depth = depth;
    if (!raw.compressed) {
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
