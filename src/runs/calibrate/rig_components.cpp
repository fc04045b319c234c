// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/rig_components.hpp"

#include <fmt/format.h>

#include <cmath>
#include <iterator>

#include "apvi/core/constants.hpp"

namespace apvi::runs {
namespace {

/// value = rig + factor * change
struct Quantity {
  std::string name;
  double rig = 0.0;
  double factor = 1.0;
};

const CameraCalibration& camera_of(const Rig& rig, const std::string& parameter) {
  return rig.cameras.at(static_cast<std::size_t>(parameter.at(3) - '0'));
}

Quantity lens_quantity(const CameraModel::Parameters& lens, const std::string& name, int k) {
  if (name.ends_with(".focal_length")) return {name + " [px]", lens.fx, lens.fx};
  if (k == 0) return {name + " x [px]", lens.cx, lens.fx};
  return {name + " y [px]", lens.cy, lens.fy};
}

// Component k of a parameter.
Quantity quantity(const Rig& rig, const std::string& name, int k) {
  const bool dvl = name.starts_with("dvl0");
  const char axis = "xyz"[k];
  if (name.ends_with(".mounting")) {
    return {fmt::format("{} {} [deg]", name, axis), 0.0, kDegreesPerRadian};
  }
  if (name.ends_with(".lever_arm")) {
    const SE3& pose = dvl ? rig.dvl->T_body_dvl : camera_of(rig, name).T_body_camera;
    return {fmt::format("{} {} [m]", name, axis), pose.translation(k)};
  }
  if (name.ends_with(".time_offset_s")) {
    return {name, dvl ? rig.dvl->time_offset_s : camera_of(rig, name).time_offset_s};
  }
  if (dvl) return {name, rig.dvl->scale, rig.dvl->scale};
  return lens_quantity(camera_of(rig, name).model.parameters(), name, k);
}

std::vector<Quantity> quantities(const Rig& rig,
                                 const std::vector<vio::CalibrationParameter>& parameters) {
  std::vector<Quantity> all;
  for (const vio::CalibrationParameter& p : parameters) {
    for (int k = 0; k < p.change.size(); ++k) all.push_back(quantity(rig, p.name, k));
  }
  return all;
}

std::string row(const RigComponent& c) {
  const std::string value = c.observable ? fmt::format("{:.5g}", c.value) : "kept";
  std::string text = fmt::format("| {} | {:.5g} | {} | {:.2g} | ", c.name, c.rig, value, c.sigma);
  text += std::isnan(c.consistency) ? "" : fmt::format("{:.1f}", c.consistency);
  for (std::size_t k = 0; k < c.dives.size(); ++k) {
    fmt::format_to(std::back_inserter(text), " | {:.5g} ± {:.2g}", c.dives[k], c.dive_sigmas[k]);
  }
  return text + " |\n";
}

}  // namespace

std::vector<RigComponent> components(const Rig& rig,
                                     const std::vector<vio::CalibrationParameter>& parameters,
                                     const CombinationInput& input, const Combination& found) {
  std::vector<RigComponent> all;
  Eigen::Index k = 0;
  for (const Quantity& q : quantities(rig, parameters)) {
    const auto index = static_cast<std::size_t>(k);
    RigComponent c{
        .name = q.name,
        .rig = q.rig,
        .value = q.rig + q.factor * found.change(k),
        .sigma = q.factor * found.sigma(k),
        .observable = found.observable[index],
        .consistency = found.consistency[static_cast<std::size_t>(input.parameter[index])]};
    for (const DiveKnowledge& dive : input.dives) {
      c.dives.push_back(q.rig + q.factor * (input.start(k) + dive.change(k)));
      c.dive_sigmas.push_back(q.factor * std::sqrt(dive.covariance(k, k)));
    }
    all.push_back(std::move(c));
    ++k;
  }
  return all;
}

std::string to_table(const RigCalibration& calibration) {
  std::string text = "| parameter | rig | estimate | sigma | chi²/dof |";
  std::string rule = "|---|---|---|---|---|";
  for (std::size_t k = 0; k < calibration.dives.size(); ++k) {
    fmt::format_to(std::back_inserter(text), " dive {} |", k + 1);
    rule += "---|";
  }
  text += "\n" + rule + "\n";
  for (const RigComponent& c : calibration.components) text += row(c);
  text += "\n";
  for (std::size_t k = 0; k < calibration.dives.size(); ++k) {
    fmt::format_to(std::back_inserter(text), "dive {}: {}\n", k + 1, calibration.dives[k]);
  }
  for (const std::string& dive : calibration.left_out) text += "left out: " + dive + "\n";
  return text;
}

}  // namespace apvi::runs
