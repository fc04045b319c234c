// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/euroc_rig.hpp"

#include <filesystem>
#include <vector>

#include "io/calibration/entry.hpp"
#include "io/calibration/lens.hpp"

namespace apvi::io {
namespace {

using config::Node;

void set_camera(const Node& sensor, Node& section) {
  if (const auto model = find_entry(sensor, "", "camera_model")) check_pinhole(*model);
  copy_list(sensor, "", "intrinsics", 4, "fx, fy, cx, cy", section);
  copy_list(sensor, "", "resolution", 2, "width, height", section);
  set_lens_of(sensor, "", "distortion_coefficients", section);
}

void set_imu(const Node& sensor, Node& section) {
  copy_numbers(sensor, "",
               {{"gyroscope_noise_density", "gyro_noise_density"},
                {"gyroscope_random_walk", "gyro_random_walk"},
                {"accelerometer_noise_density", "accel_noise_density"},
                {"accelerometer_random_walk", "accel_random_walk"}},
               section);
}

}  // namespace

bool is_sensor_yaml(const Node& file) {
  return file.find("sensor_type") != nullptr || file.find("T_BS") != nullptr;
}

Node section_of_sensor_yaml(const std::string& name, const Node& sensor) {
  if (sensor.kind != Node::Kind::map) {
    fail_at(sensor, "", "no calibration in this file: expected keys such as T_BS and rate_hz");
  }
  Node section = section_at(sensor);
  copy_numbers(sensor, "", {{"rate_hz", "rate_hz"}}, section);
  if (const auto pose = find_entry(sensor, "", "T_BS")) {
    section.member("T_BS") = pose_at(pose_of(*pose), *pose->node);
  }
  if (name.starts_with("imu")) set_imu(sensor, section);
  if (name.starts_with("cam")) set_camera(sensor, section);
  return section;
}

Node rig_of_sensor_yaml(const Node& file) {
  std::string name =
      std::filesystem::path(file.source ? *file.source : "").parent_path().filename().string();
  if (name != "imu0" && name != "cam0" && name != "cam1") {
    const Entry type = require_entry(file, "", "sensor_type", "imu or camera");
    const std::string& word = word_of(type);
    if (word != "imu" && word != "camera") {
      fail_at(*type.node, type.key, "expected imu or camera, got " + word);
    }
    name = word == "imu" ? "imu0" : "cam0";
  }
  Node rig = section_at(file);
  rig.member(name) = section_of_sensor_yaml(name, file);
  return rig;
}

bool convert_euroc_poses(Node& rig) {
  SE3 T_imu_body = SE3::identity();
  const Node* imu = rig.find("imu0");
  const bool known = imu != nullptr && imu->find("T_BS") != nullptr;
  if (known) T_imu_body = pose_of({imu->find("T_BS"), "T_BS"}).inverse();
  bool assumed = false;
  for (auto& [name, section] : rig.members) {
    const Node* pose = section.find("T_BS");
    if (pose == nullptr) continue;
    if (name != "imu0" && section.find("T_body_sensor") == nullptr) {
      const Node T_body_sensor = pose_at(T_imu_body * pose_of({pose, "T_BS"}), *pose);
      section.member("T_body_sensor") = T_body_sensor;
      assumed = assumed || !known;
    }
    std::erase_if(section.members, [](const auto& member) { return member.first == "T_BS"; });
  }
  return assumed;
}

}  // namespace apvi::io
