// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/orb_slam_rig.hpp"

#include <fmt/format.h>

#include <optional>
#include <string>
#include <vector>

#include "core/text.hpp"
#include "io/calibration/entry.hpp"
#include "io/calibration/kalibr_rig.hpp"
#include "io/calibration/lens.hpp"

namespace apvi::io {
namespace {

using config::Node;

std::optional<Entry> find_either(const Node& file, const char* key, const char* older) {
  auto entry = find_entry(file, "", key);
  return entry ? entry : find_entry(file, "", older);
}

// Intrinsics and lens of the camera whose keys begin with `prefix`.
class CameraKeys {
 public:
  CameraKeys(const Node& file, std::string prefix) : file_(file), prefix_(std::move(prefix)) {}

  Entry require(const char* name, const char* expected) const {
    return require_entry(file_, "", prefix_ + "." + name, expected);
  }
  Node intrinsics() const {
    const Entry fx = require("fx", "the focal length in pixels");
    std::vector<double> numbers = {number_of(fx)};
    for (const char* name : {"fy", "cx", "cy"}) {
      numbers.push_back(number_of(require(name, "pixels")));
    }
    return numbers_at(numbers, *fx.node);
  }
  // The coefficients up to the last one that the file has; `place` is that one.
  std::vector<double> coefficients(const std::vector<const char*>& names, Entry& place) const {
    std::vector<double> numbers;
    for (const char* name : names) {
      const auto entry = find_entry(file_, "", prefix_ + "." + name);
      if (!entry) break;
      numbers.push_back(number_of(*entry));
      place = *entry;
    }
    return numbers;
  }

 private:
  const Node& file_;
  std::string prefix_;
};

bool is_rectified(const Node& file) {
  const auto type = find_entry(file, "", "Camera.type");
  return type && text::to_lower(word_of(*type)) == "rectified";
}

void set_orb_lens(const Node& file, const CameraKeys& keys, Node& section) {
  section.member("distortion") = word_at("none", file);
  if (is_rectified(file)) return;
  const Node pinhole = word_at("PinHole", file);
  const auto given = find_entry(file, "", "Camera.type");
  const Entry type = given.value_or(Entry{&pinhole, "Camera.type"});
  Entry place = type;
  const bool fisheye = text::to_lower(word_of(type)) == "kannalabrandt8";
  const std::vector<double> k =
      fisheye ? keys.coefficients({"k1", "k2", "k3", "k4"}, place)
              : keys.coefficients({"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"}, place);
  // A pinhole camera without coefficients has no distortion.
  if (k.empty() && text::to_lower(word_of(type)) == "pinhole") return;
  set_lens(type, place, k, section);
}

Node camera_section(const Node& file, const std::string& prefix) {
  Node section = section_at(file);
  const CameraKeys keys(file, prefix);
  section.member("intrinsics") = keys.intrinsics();
  const Entry width = require_entry(file, "", "Camera.width", "pixels");
  const Entry height = require_entry(file, "", "Camera.height", "pixels");
  section.member("resolution") = numbers_at({number_of(width), number_of(height)}, *width.node);
  set_orb_lens(file, keys, section);
  copy_numbers(file, "", {{"Camera.fps", "rate_hz"}}, section);
  return section;
}

std::optional<Node> imu_section(const Node& file) {
  Node section = section_at(file);
  copy_numbers(file, "",
               {{"IMU.Frequency", "rate_hz"},
                {"IMU.NoiseGyro", "gyro_noise_density"},
                {"IMU.GyroWalk", "gyro_random_walk"},
                {"IMU.NoiseAcc", "accel_noise_density"},
                {"IMU.AccWalk", "accel_random_walk"}},
               section);
  const bool given = !section.members.empty() || find_either(file, "IMU.T_b_c1", "Tbc");
  return given ? std::optional<Node>(section) : std::nullopt;
}

// Rectified images share their intrinsics. The baseline of an RGB-D camera is not that of a camera.
std::optional<Node> rectified_second_camera(const Node& file, const std::string& prefix) {
  if (find_either(file, "RGBD.DepthMapFactor", "DepthMapFactor")) return std::nullopt;
  const auto baseline = is_rectified(file) ? find_entry(file, "", "Stereo.b") : std::nullopt;
  const auto scaled = find_entry(file, "", "Camera.bf");  // baseline times fx, before 1.0
  if (!baseline && !scaled) return std::nullopt;
  const Entry& given = baseline ? *baseline : *scaled;
  Node section = camera_section(file, prefix);
  SE3 T_cam0_cam1;
  T_cam0_cam1.translation.x() =
      number_of(given) / (baseline ? 1.0 : number_of(CameraKeys(file, prefix).require("fx", "px")));
  section.member(kStereoPose) = pose_at(T_cam0_cam1, *given.node);
  return section;
}

// The second camera of a stereo pair; nullopt for one camera.
std::optional<Node> second_camera(const Node& file, const std::string& prefix) {
  if (file.find("Camera2.fx") == nullptr) return rectified_second_camera(file, prefix);
  Node section = camera_section(file, "Camera2");
  if (const auto pose = find_either(file, "Stereo.T_c1_c2", "Tlr")) {
    section.member(kStereoPose) = pose_at(pose_of(*pose), *pose->node);
  }
  return section;
}

}  // namespace

bool is_orb_slam(const Node& file) {
  return file.find("Camera1.fx") != nullptr || file.find("Camera.fx") != nullptr;
}

Node rig_of_orb_slam(const Node& file) {
  if (const auto left = find_entry(file, "", "LEFT.K")) {
    fail_at(*left->node, left->key,
            "the intrinsics in this file are those of rectified images; expected Camera1.fx, "
            "Camera2.fx and Stereo.T_c1_c2, as in the settings of ORB-SLAM3 1.0");
  }
  Node rig = section_at(file);
  if (const auto imu = imu_section(file)) rig.member("imu0") = *imu;
  const std::string prefix = file.find("Camera1.fx") != nullptr ? "Camera1" : "Camera";
  Node camera = camera_section(file, prefix);
  if (const auto pose = find_either(file, "IMU.T_b_c1", "Tbc")) {
    camera.member("T_body_sensor") = pose_at(pose_of(*pose), *pose->node);
  }
  rig.member("cam0") = camera;
  if (const auto second = second_camera(file, prefix)) rig.member("cam1") = *second;
  return rig;
}

}  // namespace apvi::io
