// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/openvins_rig.hpp"

#include <filesystem>

#include "io/calibration/entry.hpp"
#include "io/calibration/kalibr_rig.hpp"

namespace apvi::io {
namespace {

using config::Node;

Node load_chain(const Node& file, const char* key) {
  const Entry name = require_entry(file, "", key, "the name of a calibration file");
  const std::filesystem::path folder =
      std::filesystem::path(file.source ? *file.source : "").parent_path();
  const std::filesystem::path path = folder / word_of(name);
  if (!std::filesystem::is_regular_file(path)) {
    fail_at(*name.node, name.key, "no such file: " + path.string());
  }
  const Node chain = config::load_file(path);
  if (!is_kalibr(chain)) fail_at(*name.node, name.key, path.string() + " is not a file of Kalibr");
  return rig_of_kalibr(chain);
}

// OpenVINS has one time offset for all cameras, that of cam0.
void share_time_offset(Node& rig) {
  const Node* first = rig.find("cam0");
  const Node* offset = first != nullptr ? first->find("time_offset_s") : nullptr;
  if (offset == nullptr || rig.find("cam1") == nullptr) return;
  const Node shared = *offset;
  rig.member("cam1").member("time_offset_s") = shared;
}

}  // namespace

bool is_openvins(const Node& file) {
  return file.find("relative_config_imu") != nullptr ||
         file.find("relative_config_imucam") != nullptr;
}

Node rig_of_openvins(const Node& file) {
  Node rig = load_chain(file, "relative_config_imucam");
  config::merge(rig, load_chain(file, "relative_config_imu"));
  const auto cameras = find_entry(file, "", "max_cameras");
  if (cameras && number_of(*cameras) < 2.0) {
    std::erase_if(rig.members, [](const auto& member) { return member.first == "cam1"; });
  }
  share_time_offset(rig);
  return rig;
}

}  // namespace apvi::io
