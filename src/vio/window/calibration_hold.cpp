// SPDX-License-Identifier: BSD-3-Clause
#include "vio/window/calibration_hold.hpp"

#include <limits>
#include <utility>

#include "apvi/core/log.hpp"

namespace apvi::vio {
namespace {

constexpr double kHeldFraction = 0.02;  // of the prior's standard deviation
// Errors of the model and of tracked corners, which do not average out, of the same.
constexpr double kModelError = 0.1;
// Of release_sigmas: a rig that is so wrong in one parameter is not held in others.
constexpr double kWrongRig = 1.5;
constexpr double kNoLimit = std::numeric_limits<double>::infinity();

/// The components of the tangent of a block that one parameter has.
struct Part {
  std::string name;
  const CalibrationPrior* prior = nullptr;
  int size = 0;
};

struct NamedBlock {
  Block block;
  std::vector<double> value;
  std::vector<Part> parts;
};

NamedBlock pose(PoseBlock& now, const PoseBlock& rig, const std::string& sensor,
                const CalibrationPrior& mounting, const CalibrationPrior& lever_arm) {
  return {{now.data(), kPoseSize},
          {rig.begin(), rig.end()},
          {{sensor + ".mounting", &mounting, 3}, {sensor + ".lever_arm", &lever_arm, 3}}};
}

NamedBlock number(double& now, double rig, const std::string& name, const CalibrationPrior& prior) {
  return {{&now, 1}, {rig}, {{name, &prior, 1}}};
}

std::vector<NamedBlock> named_blocks(Calibration& now, const Calibration& rig,
                                     const CalibrationConfig& c) {
  std::vector<NamedBlock> all;
  for (std::size_t k = 0; k < now.T_body_camera.size(); ++k) {
    const std::string camera = "cam" + std::to_string(k);
    all.push_back(pose(now.T_body_camera[k], rig.T_body_camera[k], camera, c.camera_mounting,
                       c.camera_lever_arm));
    all.push_back({{now.lenses[k].data(), kLensSize},
                   {rig.lenses[k].begin(), rig.lenses[k].end()},
                   {{camera + ".focal_length", &c.focal_length, 1},
                    {camera + ".principal_point", &c.principal_point, 2}}});
  }
  all.push_back(number(now.camera_time_offset_s, rig.camera_time_offset_s, "cam0.time_offset_s",
                       c.camera_time_offset));
  if (!now.has_dvl) return all;
  all.push_back(pose(now.T_body_dvl, rig.T_body_dvl, "dvl0", c.dvl_mounting, c.dvl_lever_arm));
  all.push_back(number(now.dvl_log_scale, rig.dvl_log_scale, "dvl0.scale", c.dvl_scale));
  return all;
}

// From the rig's value, in standard deviations.
double largest_deviation(const CalibrationParameter& p) {
  const double floor = kModelError * p.prior_sigma;
  return (p.change.array().abs() / (p.sigma.array().square() + floor * floor).sqrt()).maxCoeff();
}

}  // namespace

CalibrationHold::CalibrationHold(Calibration& calibration, const CalibrationConfig& config,
                                 const Rig& rig)
    : calibration_(&calibration), config_(config), rig_values_(calibration) {
  if (config.release_sigmas <= 0.0) return;
  for (const NamedBlock& block : named_blocks(calibration, rig_values_, config_)) {
    for (const Part& part : block.parts) {
      if (part.prior->estimate) held_.insert(part.name);
    }
  }
  if (!rig.dvl || rig.dvl->scale == 1.0) held_.erase("dvl0.scale");
  build_prior();
}

void CalibrationHold::build_prior() {
  prior_.reset();
  Prior prior;
  std::vector<double> inverse_sigmas;
  for (NamedBlock& block : named_blocks(*calibration_, rig_values_, config_)) {
    std::vector<double> weights;
    bool any = false;
    for (const Part& part : block.parts) {
      const bool held = holds(part.name);
      const double sigma = held ? kHeldFraction * part.prior->sigma : kNoLimit;
      weights.insert(weights.end(), static_cast<std::size_t>(part.size), 1.0 / sigma);
      any = any || held;
    }
    if (!any) continue;
    prior.kept.push_back({block.block, std::move(block.value)});
    inverse_sigmas.insert(inverse_sigmas.end(), weights.begin(), weights.end());
  }
  if (prior.kept.empty()) return;
  const auto size = static_cast<Eigen::Index>(inverse_sigmas.size());
  prior.J = Eigen::Map<const Eigen::VectorXd>(inverse_sigmas.data(), size).asDiagonal();
  prior.r = Eigen::VectorXd::Zero(size);
  prior_ = std::make_shared<const Prior>(std::move(prior));
}

void CalibrationHold::update(const std::vector<CalibrationParameter>& estimates) {
  const std::size_t before = held_.size();
  for (const CalibrationParameter& p : estimates) {
    const double sigmas = largest_deviation(p);
    if (sigmas >= config_.release_sigmas && held_.erase(p.name) > 0) {
      log::info("self-calibration: {} of the rig is off by {:.1f} sigmas: estimated from now on",
                p.name, sigmas);
    }
    if (sigmas >= kWrongRig * config_.release_sigmas && holds_any()) {
      log::info("self-calibration: {} of the rig is off by {:.1f} sigmas: all is estimated now",
                p.name, sigmas);
      held_.clear();
    }
  }
  if (held_.size() != before) build_prior();
}

}  // namespace apvi::vio
