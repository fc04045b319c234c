// SPDX-License-Identifier: BSD-3-Clause
#include "runs/relocalization.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "apvi/core/constants.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "loop_closure/place_map.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

eval::Json to_json(const SE3& pose) {
  const Eigen::Vector3d& p = pose.translation;
  const Eigen::Quaterniond& q = pose.rotation;
  return {{"position_m", {p.x(), p.y(), p.z()}}, {"rotation_xyzw", {q.x(), q.y(), q.z(), q.w()}}};
}

eval::Json to_json(const Eigen::Matrix4d& matrix) {
  eval::Json rows = eval::Json::array();
  for (const auto& row : matrix.rowwise()) {
    rows.push_back({row[0], row[1], row[2], row[3]});
  }
  return rows;
}

eval::Json found_json(const loop_closure::FoundInMap& found, Stamp first) {
  const Eigen::Matrix4d& C = found.covariance;
  return {{"found", true},
          {"found_after_s", seconds_between(first, found.stamp)},
          {"image_stamp_ns", found.stamp.ns},
          {"images", found.images},
          {"features", found.features},
          {"points", found.points},
          {"T_map_camera", to_json(found.T_known_camera)},
          {"sigma",
           {{"horizontal_m", std::sqrt(0.5 * (C(0, 0) + C(1, 1)))},
            {"vertical_m", std::sqrt(C(2, 2))},
            {"heading_deg", kDegreesPerRadian * std::sqrt(C(3, 3))}}},
          {"covariance", to_json(C)}};
}

}  // namespace

void check_known_map(const RunConfig& config, const localization::ActiveSensors& sensors,
                     const fs::path& folder) {
  const std::string& run = config.smoothing.known_map;
  if (run.empty()) return;
  loop_closure::find_place_map(run);
  std::error_code error;
  if (fs::equivalent(run, folder, error)) {
    fail_input("{}: a dive cannot replace the run in which it is to be found", run);
  }
  if (config.smoothing.enabled && sensors.imu && sensors.cameras > 0) return;
  fail_input("{}: to be found in a map needs a camera, an IMU and smoothing.enabled: true", run);
}

eval::Json report_relocalization(const RunConfig& config,
                                 const localization::VisualPipeline* visual,
                                 std::optional<Stamp> first, std::vector<std::string>& warnings) {
  const std::string& run = config.smoothing.known_map;
  if (run.empty() || !first) return eval::Json::object();
  const localization::Smoother& smoother = *visual->smoother();
  eval::Json json{{"map", run}, {"found", false}};
  const loop_closure::MapAnchors* anchors = smoother.closer().anchors();
  if (anchors == nullptr || !anchors->found()) {
    warnings.push_back(fmt::format(
        "the dive was not found in the map of {}: its results are in a frame of their own", run));
    log::warning("{}", warnings.back());
    return json;
  }
  json.update(found_json(*anchors->found(), *first));
  json["anchors"] = anchors->anchors();
  json["rejected_anchors"] = anchors->rejected();
  json["T_map_odom"] = to_json(smoother.T_map_odom());
  return json;
}

}  // namespace apvi::runs
