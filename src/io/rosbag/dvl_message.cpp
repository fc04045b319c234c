// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/dvl_message.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string_view>
#include <utility>

#include "apvi/core/log.hpp"
#include "io/folder/dvl_validity.hpp"
#include "io/rosbag/ros_fields.hpp"

namespace apvi::io {
namespace {

constexpr double kWaterMode = 2.0;     // DVL_MODE_WATER of marine_acoustic_msgs and ds_sensor_msgs
constexpr double kMinGoodBeams = 3.0;  // three beams determine a velocity
constexpr std::size_t kInstrument = 1;
// DVL_COORD_... of ds_sensor_msgs.
constexpr std::array<std::string_view, 4> kCoordinates = {"beam", "", "ship", "earth"};
// Frames of REP 105 and their usual variants, fixed to the world.
constexpr std::array<std::string_view, 6> kWorldFrames = {"map",   "odom", "earth",
                                                          "world", "ned",  "enu"};

// Covariance convention of sensor_msgs: -1 in the first element for "no measurement". In
// `velocity_covar` of ds_sensor_msgs it stands for "unknown".
bool covariance_says_invalid(const RosValue& message) {
  const RosValue* covariance =
      first_of(message, {"velocity_covariance", "twist.covariance", "covariance"});
  return covariance != nullptr && covariance->number().value_or(0.0) < 0.0;
}

std::optional<double> figure_of_merit_of(const RosValue& message) {
  if (const auto fom = message.number_at("fom")) return fom;
  if (const auto x = message.number_at("fom_x")) {
    return std::max(
        {*x, message.number_at("fom_y").value_or(0.0), message.number_at("fom_z").value_or(0.0)});
  }
  const RosValue* covariance =
      first_of(message, {"velocity_covariance", "velocity_covar", "twist.covariance"});
  const double variance = covariance == nullptr ? 0.0 : covariance->number().value_or(0.0);
  return variance > 0.0 ? std::optional<double>(std::sqrt(variance)) : std::nullopt;
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

std::optional<Eigen::Vector3d> velocity_of(const RosValue& message) {
  auto velocity = vector_of(first_of(message, {"velocity", "twist.twist.linear", "twist.linear"}));
  if (velocity) return velocity;
  const auto x = message.number_at("velocity_x");
  const auto y = message.number_at("velocity_y");
  const auto z = message.number_at("velocity_z");
  if (!x || !y || !z) return std::nullopt;
  return Eigen::Vector3d(*x, *y, *z);
}

// Whether all flags of the velocity are set; nullopt when there are none.
std::optional<bool> flagged_valid(const RosValue& message) {
  constexpr std::array<std::string_view, 5> kFlags = {"velocity_valid", "beam_velocities_valid",
                                                      "x_velocity_valid", "y_velocity_valid",
                                                      "z_velocity_valid"};
  std::optional<bool> valid;
  for (const std::string_view flag : kFlags) {
    if (const auto value = message.number_at(flag)) valid = valid.value_or(true) && *value != 0.0;
  }
  return valid;
}

bool has_enough_beams(const RosValue& message) {
  return message.number_at("num_good_beams").value_or(kMinGoodBeams) >= kMinGoodBeams;
}

bool is_water_track(const RosValue& message) {
  const RosValue* type = message.find("type");
  const auto word = type == nullptr ? std::nullopt : type->text();
  return (word && word->find("water") != std::string_view::npos) ||
         message.number_at("velocity_mode") == kWaterMode;
}

// The twist of an odometry message is in its child frame, others are in that of the header.
std::string world_frame_of(const RosValue& message) {
  const RosValue* id = message.find("header.frame_id");
  if (id == nullptr || message.find("child_frame_id") != nullptr) return "";
  const std::string_view frame = id->text().value_or("");
  const std::string_view name = frame.substr(frame.rfind('/') + 1);
  const bool world =
      std::find(kWorldFrames.begin(), kWorldFrames.end(), name) != kWorldFrames.end();
  return world ? std::string(frame) : "";
}

std::string frame_of(const RosValue& message) {
  const double mode = message.number_at("coordinate_mode").value_or(kInstrument);
  for (std::size_t i = 0; i < kCoordinates.size(); ++i) {
    if (mode == static_cast<double>(i) && i != kInstrument) return std::string(kCoordinates[i]);
  }
  return world_frame_of(message);
}

}  // namespace

DvlMeaning meaning_of(const RosValue& message) {
  return {.water_track = is_water_track(message), .frame = frame_of(message)};
}

std::optional<SensorEvent> dvl_of(const RosValue& message, Stamp stamp) {
  const auto velocity = velocity_of(message);
  if (!velocity) return std::nullopt;
  DvlSample sample;
  sample.stamp = stamp;
  sample.velocity = *velocity;
  sample.figure_of_merit = figure_of_merit_of(message);
  sample.altitude = message.number_at("altitude");
  add_beams(message, sample);
  const DvlMeaning meaning = meaning_of(message);
  sample.valid = flagged_valid(message).value_or(infer_validity(sample)) &&
                 has_enough_beams(message) && !covariance_says_invalid(message) &&
                 !meaning.water_track && meaning.frame.empty();
  clear_placeholder_values(sample);
  return sample;
}

MessageToEvent dvl_converter(std::string topic) {
  struct Reported {
    bool water_track = false;
    bool frame = false;
  };
  return [topic = std::move(topic), reported = std::make_shared<Reported>()](
             const RosValue& message, Stamp stamp) -> std::optional<SensorEvent> {
    const DvlMeaning meaning = meaning_of(message);
    if (meaning.water_track && !std::exchange(reported->water_track, true)) {
      log::warning("{}: water track at {:.3f}: velocities against the water are not used", topic,
                   stamp.seconds());
    }
    if (!meaning.frame.empty() && !std::exchange(reported->frame, true)) {
      log::warning(
          "{}: velocities in {} coordinates at {:.3f} are not used; record them in those of the "
          "instrument",
          topic, meaning.frame, stamp.seconds());
    }
    return dvl_of(message, stamp);
  };
}

}  // namespace apvi::io
