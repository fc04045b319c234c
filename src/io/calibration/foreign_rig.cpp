// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/foreign_rig.hpp"

#include <fmt/format.h>

#include <string>
#include <utility>
#include <vector>

#include "io/calibration/assumptions.hpp"
#include "io/calibration/camera_info_rig.hpp"
#include "io/calibration/entry.hpp"
#include "io/calibration/euroc_rig.hpp"
#include "io/calibration/kalibr_rig.hpp"
#include "io/calibration/openvins_rig.hpp"
#include "io/calibration/orb_slam_rig.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;
using config::Node;

// The imu.yaml that Kalibr writes beside a camchain, with the same prefix or suffix.
fs::path imu_file_beside(const Node& file) {
  const fs::path path = file.source ? *file.source : "";
  std::string name = path.filename().string();
  for (const std::string part : {"camchain-imucam", "camchain", "imucam_chain"}) {
    const std::size_t at = name.find(part);
    if (at == std::string::npos) continue;
    name.replace(at, part.size(), part == "imucam_chain" ? "imu_chain" : "imu");
    const fs::path beside = path.parent_path() / name;
    return fs::is_regular_file(beside) ? beside : fs::path{};
  }
  return {};
}

Node rig_of_kalibr_files(const Node& file) {
  Node rig = rig_of_kalibr(file);
  const Node* imu = rig.find("imu0");
  if (imu == nullptr || !imu->members.empty()) return rig;
  const fs::path beside = imu_file_beside(file);
  if (beside.empty()) return rig;
  const Node imu_file = config::load_file(beside);
  if (!is_kalibr(imu_file)) return rig;
  log_once(log::Level::info,
           fmt::format("{}: imu0 is read from {}", *file.source, beside.string()));
  config::merge(rig, rig_of_kalibr(imu_file));
  return rig;
}

void resolve_stereo_pose(Node& rig) {
  const Node* given = rig.find("cam1");
  const Node* pose = given != nullptr ? given->find(kStereoPose) : nullptr;
  if (pose == nullptr) return;
  const Node stereo = *pose;
  Node& second = rig.member("cam1");
  std::erase_if(second.members, [](const auto& member) { return member.first == kStereoPose; });
  if (second.find("T_body_sensor") != nullptr) return;
  SE3 T_body_cam0 = SE3::identity();
  const Node* first = rig.find("cam0");
  if (first != nullptr) {
    if (const auto known = find_entry(*first, "cam0", "T_body_sensor")) {
      T_body_cam0 = pose_of(*known);
    }
  }
  second.member("T_body_sensor") =
      pose_at(T_body_cam0 * pose_of({&stereo, std::string("cam1.") + kStereoPose}), stereo);
}

void check_cameras(const Node& rig) {
  const Node* second = rig.find("cam1");
  if (second != nullptr && rig.find("cam0") == nullptr) {
    fail_at(*second, "cam1",
            "there is no cam0: inherit the file of the first camera too, or rename this camera "
            "(a CameraInfo is cam1 if its file or camera_name says right or cam1)");
  }
  for (const char* name : {"cam0", "cam1"}) {
    const Node* camera = rig.find(name);
    if (camera == nullptr) continue;
    require_entry(*camera, name, "intrinsics", "fx, fy, cx, cy");
    require_entry(*camera, name, "resolution", "width, height");
  }
  if (second == nullptr) return;
  require_entry(*second, "cam1", "T_body_sensor",
                "its pose against the IMU or cam0: Kalibr's T_cam_imu or T_cn_cnm1, ORB-SLAM3's "
                "Stereo.T_c1_c2, EuRoC's T_BS, or this key in a rig.yaml that inherits the file");
}

// Sections of rig.yaml that were added to a file of another tool.
Node sections_of_rig(const Node& file) {
  Node own;
  for (const char* name :
       {"world", "body", "imu0", "cam0", "cam1", "dvl0", "pressure0", "depth0", "lamp0"}) {
    if (const Node* section = file.find(name)) own.member(name) = *section;
  }
  return own;
}

}  // namespace

bool convert_foreign(Node& file) {
  const Node own = sections_of_rig(file);
  if (is_openvins(file)) {
    file = rig_of_openvins(file);
  } else if (is_orb_slam(file)) {
    file = rig_of_orb_slam(file);
  } else if (is_camera_info(file)) {
    file = rig_of_camera_info(file);
  } else if (is_sensor_yaml(file)) {
    file = rig_of_sensor_yaml(file);
  } else if (is_kalibr(file)) {
    file = rig_of_kalibr_files(file);  // keeps them itself
    return true;
  } else {
    return false;
  }
  if (!own.is_null()) config::merge(file, own);
  return true;
}

void finish_foreign(Node& rig, const std::string& name) {
  std::vector<std::string> assumed;
  if (convert_euroc_poses(rig)) assumed.emplace_back("imu0.T_BS = identity");
  resolve_stereo_pose(rig);
  check_cameras(rig);
  log_assumptions(rig, name, std::move(assumed));
}

Node load_euroc_rig(const fs::path& mav) {
  Node rig;
  for (const char* name : {"imu0", "cam0", "cam1"}) {
    const fs::path yaml = mav / name / "sensor.yaml";
    if (!fs::exists(yaml)) continue;
    rig.member(name) = section_of_sensor_yaml(name, config::load_file(yaml));
  }
  if (!rig.is_null()) finish_foreign(rig, mav.string());
  return rig;
}

}  // namespace apvi::io
