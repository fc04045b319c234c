// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/kalibr_rig.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <string>
#include <vector>

#include "io/calibration/assumptions.hpp"
#include "io/calibration/entry.hpp"
#include "io/calibration/lens.hpp"
#include "io/calibration/sphere_camera.hpp"

namespace apvi::io {
namespace {

using config::Node;

bool has_any(const Node& node, std::initializer_list<const char*> keys) {
  return std::any_of(keys.begin(), keys.end(),
                     [&](const char* key) { return node.find(key) != nullptr; });
}

bool is_camera(const Node& node) {
  return has_any(node, {"camera_model", "distortion_model", "distortion_coeffs", "T_cam_imu",
                        "T_imu_cam", "T_cn_cnm1", "timeshift_cam_imu"});
}

bool is_imu(const Node& node) {
  return has_any(node, {"gyroscope_noise_density", "accelerometer_noise_density"});
}

// Sections of rig.yaml may use both vocabularies. Copies what is not Kalibr's; `pairs` are keys of
// both that say the same.
void copy_own(const Node& from, const std::string& path, std::initializer_list<const char*> keys,
              const std::vector<RenamedKey>& pairs, Node& section) {
  for (const auto& [theirs, ours] : pairs) {
    const auto entry = find_entry(from, path, theirs);
    if (entry && from.find(ours) != nullptr) {
      fail_at(*entry->node, entry->key, fmt::format("{} says the same; delete one of them", ours));
    }
  }
  for (const char* key : keys) {
    if (const Node* value = from.find(key)) section.member(key) = *value;
  }
}

void set_poses(const Node& camera, const std::string& path, Node& section) {
  if (const auto pose = find_entry(camera, path, "T_cam_imu")) {
    section.member("T_body_sensor") = pose_at(pose_of(*pose).inverse(), *pose->node);
  } else if (const auto inverse = find_entry(camera, path, "T_imu_cam")) {
    section.member("T_body_sensor") = pose_at(pose_of(*inverse), *inverse->node);
  } else if (const auto stereo = find_entry(camera, path, "T_cn_cnm1"); stereo && path == "cam1") {
    section.member(kStereoPose) = pose_at(pose_of(*stereo).inverse(), *stereo->node);
  }
}

Node camera_section(const Node& camera, const std::string& path) {
  Node section = section_at(camera);
  copy_own(
      camera, path,
      {"model", "distortion", "coefficients", "rate_hz", "T_body_sensor", "time_offset_s", "port"},
      {{"T_cam_imu", "T_body_sensor"},
       {"T_imu_cam", "T_body_sensor"},
       {"timeshift_cam_imu", "time_offset_s"},
       {"distortion_model", "distortion"},
       {"distortion_coeffs", "coefficients"}},
      section);
  if (!set_sphere_camera(camera, path, section)) {
    if (const auto model = find_entry(camera, path, "camera_model")) check_pinhole(*model);
    copy_list(camera, path, "intrinsics", 4, "fx, fy, cx, cy", section);
    set_lens_of(camera, path, "distortion_coeffs", section);
  }
  copy_list(camera, path, "resolution", 2, "width, height", section);
  set_poses(camera, path, section);
  if (const auto shift = find_entry(camera, path, "timeshift_cam_imu")) {
    section.member("time_offset_s") = number_at(0.0 - number_of(*shift), *shift->node);
  }
  return section;
}

// Whether the numbers of a member, if any, differ from the identity matrix times `diagonal`.
bool differs(const Node& imu, const std::string& path, const char* key, double diagonal) {
  const auto entry = find_entry(imu, path, key);
  if (!entry) return false;
  const std::vector<double> m = numbers_of(*entry, 9, "a 3x3 matrix");
  for (std::size_t i = 0; i < m.size(); ++i) {
    if (std::abs(m[i] - (i % 4 == 0 ? diagonal : 0.0)) > 1e-12) return true;
  }
  return false;
}

void warn_of_errors_not_modeled(const Node& imu, const std::string& path) {
  std::vector<std::string> ignored;
  for (const char* key : {"Tw", "Ta", "R_IMUtoGYRO", "R_IMUtoACC"}) {
    if (differs(imu, path, key, 1.0)) ignored.emplace_back(key);
  }
  if (differs(imu, path, "Tg", 0.0)) ignored.emplace_back("Tg");
  for (const char* key : {"gyroscopes", "accelerometers"}) {
    if (imu.find(key) != nullptr) ignored.emplace_back(key);
  }
  if (ignored.empty()) return;
  log_once(
      log::Level::warning,
      fmt::format("{}: {}: scale and misalignment are not modeled and are ignored; correct the "
                  "samples",
                  imu.where(), fmt::join(ignored, ", ")));
}

Node imu_section(const Node& imu, const std::string& path) {
  static const std::vector<RenamedKey> keys = {
      {"update_rate", "rate_hz"},
      {"gyroscope_noise_density", "gyro_noise_density"},
      {"gyroscope_random_walk", "gyro_random_walk"},
      {"accelerometer_noise_density", "accel_noise_density"},
      {"accelerometer_random_walk", "accel_random_walk"}};
  Node section = section_at(imu);
  copy_own(imu, path,
           {"rate_hz", "gyro_noise_density", "gyro_random_walk", "accel_noise_density",
            "accel_random_walk"},
           keys, section);
  copy_numbers(imu, path, keys, section);
  if (const auto pose = find_entry(imu, path, "T_i_b")) {
    if ((pose_of(*pose).matrix() - Eigen::Matrix4d::Identity()).norm() > 1e-6) {
      fail_at(*pose->node, pose->key, "expected the identity: imu0 is the body");
    }
  }
  if (const auto offset = find_entry(imu, path, "time_offset"); offset && number_of(*offset) != 0) {
    fail_at(*offset->node, offset->key, "expected 0: time offsets are against the clock of imu0");
  }
  warn_of_errors_not_modeled(imu, path);
  return section;
}

bool is_further_sensor(const std::string& name) {
  const bool numbered = name.size() > 3 && (name.starts_with("cam") || name.starts_with("imu")) &&
                        name.find_first_not_of("0123456789", 3) == std::string::npos;
  return numbered && name != "cam0" && name != "cam1" && name != "imu0";
}

}  // namespace

bool is_kalibr(const Node& file) {
  if (is_imu(file)) return true;
  return std::any_of(file.members.begin(), file.members.end(), [](const auto& member) {
    const auto& [name, node] = member;
    return (name.starts_with("cam") && is_camera(node)) ||
           (name.starts_with("imu") && is_imu(node));
  });
}

Node rig_of_kalibr(const Node& file) {
  Node rig = section_at(file);
  if (is_imu(file)) {
    rig.member("imu0") = imu_section(file, "");
    return rig;
  }
  for (const auto& [name, node] : file.members) {
    if (is_further_sensor(name)) {
      log_once(log::Level::info,
               fmt::format("{}: {} is ignored: imu0, cam0 and cam1 are used", node.where(), name));
    } else if (name.starts_with("cam") && is_camera(node)) {
      rig.member(name) = camera_section(node, name);
      // A camera that was calibrated to an IMU implies one.
      if (has_any(node, {"T_cam_imu", "T_imu_cam"})) {
        Node& imu = rig.member("imu0");
        if (imu.is_null()) imu = section_at(node);
      }
    } else if (name.starts_with("imu") && is_imu(node)) {
      rig.member(name) = imu_section(node, name);
    } else {
      rig.member(name) = node;
    }
  }
  return rig;
}

}  // namespace apvi::io
