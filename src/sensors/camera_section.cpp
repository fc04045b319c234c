// SPDX-License-Identifier: BSD-3-Clause
#include "sensors/camera_section.hpp"

#include <cmath>
#include <stdexcept>

#include "apvi/core/constants.hpp"
#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"
#include "apvi/sensors/central_fit.hpp"
#include "apvi/sensors/lens.hpp"
#include "sensors/camera_mask.hpp"
#include "sensors/pose_node.hpp"

namespace apvi {
namespace {

using config::Node;

Port to_port(const PortSection& section, const Node& node, const std::string& key) {
  const bool flat = section.kind == PortKind::flat;
  if (flat && !section.distance_m) {
    fail_at(node, key + ".distance_m",
            "missing: a flat port needs the distance to the lens center");
  }
  if (!flat && !section.radius_m) {
    fail_at(node, key + ".radius_m", "missing: a dome needs its inner radius");
  }
  const Eigen::Vector3d tilt(section.tilt_deg[0], section.tilt_deg[1], 0.0);
  return {.kind = section.kind,
          .glass_thickness_m = section.glass_thickness_m,
          .air_index = section.air_index,
          .glass_index = section.glass_index,
          .water_index = section.water_index,
          .normal = so3::exp(kRadiansPerDegree * tilt) * Eigen::Vector3d::UnitZ(),
          .distance_m = section.distance_m.value_or(Port{}.distance_m),
          .radius_m = section.radius_m.value_or(Port{}.radius_m),
          .center = {section.center_m[0], section.center_m[1], section.center_m[2]}};
}

CameraModel to_lens(const CameraSection& section, const Node& node, const std::string& key) {
  if (section.model != "pinhole") {
    fail_at(node, key + ".model", "only pinhole is supported; wide lenses are a `distortion`");
  }
  if (section.intrinsics[0] <= 0.0 || section.intrinsics[1] <= 0.0) {
    fail_at(node, key + ".intrinsics", "fx and fy must be positive");
  }
  if (section.resolution[0] == 0) fail_at(node, key + ".resolution", "missing: [width, height]");
  CameraModel::Parameters p;
  p.fx = section.intrinsics[0];
  p.fy = section.intrinsics[1];
  p.cx = section.intrinsics[2];
  p.cy = section.intrinsics[3];
  p.width = section.resolution[0];
  p.height = section.resolution[1];
  const Node* list = node.find("coefficients");
  try {
    set_lens(section.distortion, section.coefficients, p);
  } catch (const std::invalid_argument& e) {
    fail_at(list != nullptr ? *list : node, key + ".coefficients", e.what());
  }
  return CameraModel(p);
}

void add_port(const PortSection& section, const Node& node, const std::string& key,
              CameraCalibration& camera) {
  const Node* place = node.find("port");
  const Node& at = place != nullptr ? *place : node;
  const Port port = to_port(section, at, key);
  try {
    const PortCamera behind(camera.model, port);
    const CentralCamera central = fit_central_camera(behind, section.working_range_m);
    camera.port = PortCalibration{behind, -central.center, section.working_range_m};
    camera.model = central.model;
    camera.T_body_camera.translation = camera.T_body_camera * central.center;
  } catch (const InputError& e) {
    fail_at(at, key, e.what());
  }
}

}  // namespace

CameraCalibration to_camera(const CameraSection& section, const Node& node,
                            const std::string& key) {
  CameraCalibration camera{.model = to_lens(section, node, key),
                           .T_body_camera = to_pose(section.T_body_sensor, key + ".T_body_sensor"),
                           .rate_hz = section.rate_hz,
                           .time_offset_s = section.time_offset_s};
  if (section.port) add_port(*section.port, node, key + ".port", camera);
  if (!section.mask.empty()) {
    const Node* place = node.find("mask");
    try {
      camera.mask = load_camera_mask(section.mask, camera.model);
    } catch (const Error& e) {
      fail_at(place != nullptr ? *place : node, key + ".mask", e.what());
    }
  }
  return camera;
}

}  // namespace apvi
