// SPDX-License-Identifier: BSD-3-Clause
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "viewer/message.hpp"

namespace apvi::viewer {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxPoses = 20000;  // of a message

// Tenths of a millimeter suffice on a screen and halve the message.
double rounded(double x) {
  return std::round(x * 1e4) / 1e4;
}

Json vector_json(const Eigen::Vector3d& v) {
  return {rounded(v.x()), rounded(v.y()), rounded(v.z())};
}

// [w, x, y, z, x, y, z]
Json pose_json(const SE3& pose) {
  const Eigen::Quaterniond& q = pose.rotation;
  const Eigen::Vector3d& p = pose.translation;
  return {rounded(q.w()), rounded(q.x()), rounded(q.y()), rounded(q.z()),
          rounded(p.x()), rounded(p.y()), rounded(p.z())};
}

// Every n-th, and the last one.
template <typename T>
std::vector<const T*> thinned(const std::vector<T>& all) {
  const std::size_t step = all.size() / kMaxPoses + 1;
  std::vector<const T*> some;
  for (std::size_t i = 0; i < all.size(); i += step) some.push_back(&all[i]);
  if (!all.empty() && (all.size() - 1) % step != 0) some.push_back(&all.back());
  return some;
}

double seconds_of(Stamp stamp) {
  return static_cast<double>(stamp.ns) / 1e9;
}

// Columns of equal length: stamps [s], poses and states.
void add_trace(Json& json, const std::vector<TracePose>& trace) {
  Json stamps = Json::array();
  Json poses = Json::array();
  Json states = Json::array();
  for (const TracePose* p : thinned(trace)) {
    stamps.push_back(seconds_of(p->pose.stamp));
    poses.push_back(pose_json(p->pose.T_world_body));
    states.push_back(p->state);
  }
  json["stamps"] = std::move(stamps);
  json["poses"] = std::move(poses);
  json["states"] = std::move(states);
}

Json keyframes_json(const std::vector<SE3>& keyframes) {
  Json json = Json::array();
  for (const SE3* pose : thinned(keyframes)) json.push_back(pose_json(*pose));
  return json;
}

Json loops_json(const std::vector<LoopLine>& loops) {
  Json json = Json::array();
  for (const LoopLine* l : thinned(loops)) {
    json.push_back({seconds_of(l->from), seconds_of(l->to)});
  }
  return json;
}

// Beam i is bit i.
unsigned bits(const std::array<bool, kBeams>& flags) {
  unsigned out = 0;
  for (std::size_t i = 0; i < kBeams; ++i) out |= static_cast<unsigned>(flags.at(i)) << i;
  return out;
}

// Columns of equal length.
void add_pings(Json& json, const std::vector<BeamPing>& pings) {
  json.update({{"stamps", Json::array()},
               {"lengths", Json::array()},
               {"valid", Json::array()},
               {"measured", Json::array()}});
  for (const BeamPing* ping : thinned(pings)) {
    Json lengths = Json::array();
    for (const double length : ping->length_m) lengths.push_back(std::round(length * 1e3) / 1e3);
    json["stamps"].push_back(seconds_of(ping->stamp));
    json["lengths"].push_back(std::move(lengths));
    json["valid"].push_back(bits(ping->valid));
    json["measured"].push_back(bits(ping->measured));
  }
}

Json beams_json(const Beams& beams) {
  Json directions = Json::array();
  for (const Eigen::Vector3d& d : beams.directions) directions.push_back(vector_json(d));
  Json json{{"mount", pose_json(beams.T_body_dvl)}, {"directions", std::move(directions)}};
  add_pings(json, beams.pings);
  return json;
}

Json sensors_json(const std::vector<SensorTrack>& sensors) {
  Json json = Json::array();
  for (const SensorTrack& sensor : sensors) {
    Json spans = Json::array();
    for (const auto& [begin, end] : sensor.spans) {
      spans.push_back({seconds_of(begin), seconds_of(end)});
    }
    json.push_back({{"name", sensor.name}, {"spans", std::move(spans)}});
  }
  return json;
}

Json map_json(const SceneDescription& d, const char* type) {
  return {{"type", type},
          {"medium", d.medium},
          {"gaussians", d.gaussians},
          {"center", vector_json(d.center)},
          {"radius_m", rounded(d.radius_m)},
          {"keyframes", keyframes_json(d.keyframes)}};
}

std::string dumped(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace

std::string scene_message(const SceneDescription& d) {
  Json json = map_json(d, "scene");
  json.update({{"name", d.name},
               {"live", d.live},
               {"can_pause", d.can_pause},
               {"can_save", d.can_save},
               {"loops", loops_json(d.loops)},
               {"beams", d.beams ? beams_json(*d.beams) : Json(nullptr)},
               {"sensors", sensors_json(d.sensors)},
               {"up", vector_json(d.up)},
               {"origin", {d.origin.x(), d.origin.y(), d.origin.z()}},
               {"focal", d.focal},
               {"aspect", d.aspect},
               {"body_camera", pose_json(d.T_body_camera)}});
  add_trace(json, d.trace);
  return dumped(json);
}

std::string poses_message(const std::vector<TracePose>& trace) {
  Json json{{"type", "poses"}};
  add_trace(json, trace);
  return dumped(json);
}

std::string map_message(const SceneDescription& description) {
  return dumped(map_json(description, "map"));
}

std::string loops_message(const std::vector<LoopLine>& loops) {
  return dumped({{"type", "loops"}, {"loops", loops_json(loops)}});
}

std::string beams_message(const Beams& beams) {
  return dumped({{"type", "beams"}, {"beams", beams_json(beams)}});
}

std::string pings_message(const std::vector<BeamPing>& pings) {
  Json json{{"type", "pings"}};
  add_pings(json, pings);
  return dumped(json);
}

std::string sensors_message(const std::vector<SensorTrack>& sensors) {
  return dumped({{"type", "sensors"}, {"sensors", sensors_json(sensors)}});
}

std::string saved_message(const std::string& error) {
  return dumped({{"type", "saved"}, {"error", error}});
}

std::string status_message(const std::vector<std::pair<std::string, std::string>>& figures,
                           bool paused) {
  Json rows = Json::array();
  for (const auto& [name, value] : figures) rows.push_back({name, value});
  return dumped({{"type", "status"}, {"figures", std::move(rows)}, {"paused", paused}});
}

}  // namespace apvi::viewer
