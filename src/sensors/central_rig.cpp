// SPDX-License-Identifier: BSD-3-Clause
#include "sensors/central_rig.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <string>
#include <vector>

#include "apvi/sensors/lens.hpp"

namespace apvi {
namespace {

using config::Node;

Node list_of(const std::vector<double>& numbers) {
  return config::parse_yaml(fmt::format("[{:.10g}]", fmt::join(numbers, ", ")), "central camera");
}

void set_central(const CameraCalibration& camera, Node& section) {
  const CameraModel::Parameters& p = camera.model.parameters();
  section.member("intrinsics") = list_of({p.fx, p.fy, p.cx, p.cy});
  section.member("distortion") =
      config::parse_yaml(std::string(lens_name(p.distortion)), "central camera");
  section.member("coefficients") = list_of(coefficients_of(p));
  const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> m = camera.T_body_camera.matrix();
  section.member("T_body_sensor") = list_of({m.data(), m.data() + m.size()});
  std::erase_if(section.members, [](const auto& member) { return member.first == "port"; });
}

}  // namespace

Node central_rig(const Node& node, const Rig& rig) {
  Node central = node;
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    if (rig.cameras[i].port) set_central(rig.cameras[i], central.member(fmt::format("cam{}", i)));
  }
  return central;
}

}  // namespace apvi
