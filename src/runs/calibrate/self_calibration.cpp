// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/self_calibration.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>

#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"

namespace apvi::runs {
namespace {

constexpr const char* kDvlTimeOffset = "dvl0.time_offset_s";

config::Node numbers(const std::vector<double>& values) {
  return config::parse_yaml(fmt::format("[{:.9g}]", fmt::join(values, ", ")), "estimate");
}

config::Node number(double value) {
  return config::parse_yaml(fmt::format("{:.9g}", value), "estimate");
}

config::Node matrix(const SE3& pose) {
  Eigen::Matrix<double, 4, 4, Eigen::RowMajor> m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = pose.rotation.toRotationMatrix();
  m.topRightCorner<3, 1>() = pose.translation;
  return numbers({m.data(), m.data() + m.size()});
}

// Behind a port the rig describes the lens in air, which changes as its central camera does.
void set_camera(config::Node& node, const CameraCalibration& camera,
                const CameraCalibration& before) {
  const CameraModel::Parameters& now = camera.model.parameters();
  const CameraModel::Parameters& old = before.model.parameters();
  const CameraModel::Parameters& lens = before.lens().parameters();
  node.member("intrinsics") = numbers({lens.fx * now.fx / old.fx, lens.fy * now.fy / old.fy,
                                       lens.cx + now.cx - old.cx, lens.cy + now.cy - old.cy});
  node.member("T_body_sensor") = matrix(camera.T_body_lens());
  node.member("time_offset_s") = number(camera.time_offset_s);
}

// The sound speed is the scale times the one that the device assumes.
void set_dvl(config::Node& node, const DvlCalibration& dvl) {
  node.member("T_body_sensor") = matrix(dvl.T_body_dvl);
  node.member("time_offset_s") = number(dvl.time_offset_s);
  const config::Node* assumed = node.find("assumed_sound_speed");
  const double device_speed = assumed != nullptr ? std::stod(assumed->text) : 1500.0;
  node.member("sound_speed") = number(dvl.scale * device_speed);
}

std::vector<double> to_list(const Eigen::VectorXd& v) {
  return {v.begin(), v.end()};
}

eval::Json value_json(const Eigen::VectorXd& v) {
  if (v.size() == 1) return v(0);
  return to_list(v);
}

bool differs(const vio::CalibrationParameter& p) {
  const Eigen::ArrayXd limit = 3.0 * p.sigma.array().max(p.prior_sigma);
  return p.observable() && (p.change.array().abs() > limit).any();
}

}  // namespace

void append_time_offset(const DvlTimeOffset& offset, double rig_s, double prior_sigma_s,
                        vio::CalibrationEstimate& estimate) {
  const auto scalar = [](double value) { return Eigen::VectorXd::Constant(1, value); };
  estimate.parameters.push_back({.name = kDvlTimeOffset,
                                 .change = scalar(offset.value_s - rig_s),
                                 .sigma = scalar(offset.sigma_s),
                                 .prior_sigma = prior_sigma_s});
  const Eigen::Index size = estimate.covariance.rows();
  Eigen::MatrixXd both = Eigen::MatrixXd::Zero(size + 1, size + 1);
  both.topLeftCorner(size, size) = estimate.covariance;
  both(size, size) = offset.sigma_s * offset.sigma_s;
  estimate.covariance = std::move(both);
}

Rig changed(const Rig& rig, const std::vector<vio::CalibrationParameter>& parameters) {
  Rig result = vio::calibrated(rig, vio::with_changes(rig, parameters));
  for (const vio::CalibrationParameter& p : parameters) {
    if (result.dvl && p.name == kDvlTimeOffset) result.dvl->time_offset_s += p.change(0);
  }
  return result;
}

config::Node estimated_rig(const config::Node& rig, const Rig& estimate) {
  config::Node out = rig;
  const Rig before = make_rig(rig);
  for (std::size_t k = 0; k < estimate.cameras.size(); ++k) {
    set_camera(out.member("cam" + std::to_string(k)), estimate.cameras[k], before.cameras[k]);
  }
  if (estimate.dvl) set_dvl(out.member("dvl0"), *estimate.dvl);
  return out;
}

eval::Json self_calibration_json(const std::vector<vio::CalibrationParameter>& parameters) {
  eval::Json json = eval::Json::object();
  for (const vio::CalibrationParameter& p : parameters) {
    json[p.name] = {{"change", value_json(p.change)},
                    {"sigma", value_json(p.sigma)},
                    {"prior_sigma", p.prior_sigma},
                    {"held", p.held},
                    {"observable", p.observable()}};
  }
  return json;
}

eval::Json report_self_calibration(const std::filesystem::path& file, const config::Node& rig,
                                   const std::vector<vio::CalibrationParameter>& parameters) {
  const auto told = [](const vio::CalibrationParameter& p) { return p.observable(); };
  if (std::ranges::none_of(parameters, told)) return eval::Json::object();
  std::vector<vio::CalibrationParameter> in_use = parameters;
  std::erase_if(in_use, [](const vio::CalibrationParameter& p) { return p.held; });
  const Rig estimate = changed(make_rig(rig), in_use);
  io::write_text_file(file, "# The rig with the calibration that this run estimated.\n" +
                                config::to_yaml(estimated_rig(rig, estimate)));
  for (const vio::CalibrationParameter& p : in_use) {
    if (!differs(p)) continue;
    log::warning("self-calibration: {} differs from the rig by {:.4g} (sigma {:.2g}): see {}",
                 p.name, fmt::join(to_list(p.change), ", "), p.sigma.maxCoeff(), file.string());
  }
  return self_calibration_json(parameters);
}

}  // namespace apvi::runs
